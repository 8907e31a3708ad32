"""What pytest-xdist starts for a worker: ``python -I -S worker_client.py SOCKET ...``; see workers.py."""

import os
import socket
import sys

origin = socket.socket(socket.AF_UNIX)
origin.connect(sys.argv[1])
socket.send_fds(origin, [b"w"], [0, 1, 2])
# The worker alone keeps the ends of its pipes open.
for descriptor in (0, 1):
    os.close(descriptor)
origin.recv(1)  # until the worker ends
os._exit(0)
