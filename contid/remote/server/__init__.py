"""The daemon side of the socket."""
