"""The local socket: the daemon's server, what crosses it, and the clients behind `contid.client`."""
