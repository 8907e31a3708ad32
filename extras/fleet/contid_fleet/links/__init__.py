"""Connections: of the bridge to a daemon, of operators through it, and set-points under way."""
