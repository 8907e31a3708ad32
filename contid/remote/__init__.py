"""Orders and telemetry over a Unix socket: the protocol, the daemon's server, and the clients.

protocol/   wire (lines, codes), connect, socket_path, peer_credentials
server/     server > connection > turns, request_handler > stop_orders, motion_orders, query_handler
            moves > gotos, preconditions; lease, trackers, pending_orders: what requests change
            telemetry_view: robots and buses as clients see them
            stop_server: the socket of commands that move a robot without a daemon
client/     sync_client > procedures > orders > client_protocol, wires
"""
