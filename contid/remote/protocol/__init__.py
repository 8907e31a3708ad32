"""The socket protocol: messages, socket paths, peer credentials."""
