"""The local socket: server and client."""
