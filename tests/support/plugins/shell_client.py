"""What a shell of the tests starts for `contid`: ``python -I -S shell_client.py SOCKET ARGUMENTS``."""

import json
import os
import signal
import socket
import struct
import sys
from typing import Final

#: What a shell or `kill` sends to a command.
PASSED_ON: Final = (
    signal.SIGHUP,
    signal.SIGINT,
    signal.SIGQUIT,
    signal.SIGTERM,
    signal.SIGUSR1,
    signal.SIGUSR2,
)

server = socket.socket(socket.AF_UNIX)
server.connect(sys.argv[1])
request = {"arguments": sys.argv[2:], "folder": os.getcwd(), "environment": dict(os.environ)}  # noqa: PTH109
body = json.dumps(request).encode()
socket.send_fds(server, [struct.pack("!I", len(body))], [0, 1, 2])
server.sendall(body)
for each in PASSED_ON:
    signal.signal(each, lambda number, _: server.sendall(bytes([number])))
# The command alone keeps the ends of pipes open.
for descriptor in (0, 1):
    os.close(descriptor)
answer = server.recv(4, socket.MSG_WAITALL)
code = struct.unpack("!i", answer)[0] if len(answer) == 4 else 1
if code < 0:
    signal.signal(-code, signal.SIG_DFL)
    os.kill(os.getpid(), -code)
os._exit(code)
