"""The events of a run as types; their JSON and its schema derive from the fields declared here.

The control process writes them into the ring, the recorder into the session file. Daemon, server and viewer
match on the types. An event of a kind or with values that this version does not know is an `UnknownEvent`.
"""
