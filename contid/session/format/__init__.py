"""The MCAP layout of a session: channels, encoding, metadata."""
