"""Orders and telemetry over a Unix socket: the daemon's side, and the clients of `contid.client`.

A request on its way through the daemon::

    place, peer    where the socket is, and who may enter
    server         takes clients in; a `connection` for each, its `outbox` bounded
    protocol       lines, limits, errors
    verbs          one method per verb; `reading` has those that need no right
      right        who may move
      moves        points and rows (`move` counts credit, `readiness` refuses)
      trackers     who measures which tip
      ledger       what the control process did with the orders
    picture        what is told about robots; `health` about buses

A client is a `dialogue` (words) and `steps` (what takes several requests), both without I/O, below
`sync_client` and `async_client`. `door` is the socket of commands that move a robot without a daemon;
`screen`, `rows_of` and `handbook` serve the commands at a terminal.
"""
