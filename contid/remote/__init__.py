"""Orders and telemetry over a Unix socket: the protocol, the daemon's server, and the clients.

protocol/   wire (lines, codes), socket_path, peer_credentials
server/     server > connection > turns, request_handler > query_handler, lease, moves, trackers,
            pending_orders
            telemetry_view: robots and buses as clients see them
            stop_server: the socket of commands that move a robot without a daemon
client/     async_client, sync_client > procedures > client_protocol
"""
