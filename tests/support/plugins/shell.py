"""A command `contid` for scripts of a shell: forked from the starter of the tests as their own commands are.

The shell starts a small program (`shell_client.py`) in place of contid. It sends its arguments, folder,
environment and standard streams to a thread here, which starts the command, passes on signals and answers
with the exit code. With the mark `true_process` the thread starts commands as users do.
"""

from __future__ import annotations

import os
import select
import shlex
import socket
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from tests.support.plugins import starter

CLIENT: Final = Path(__file__).parent / "shell_client.py"


@contextmanager
def contid_for_shells(commands: Path) -> Iterator[None]:
    """The executable `contid` in a folder, for `PATH`; what still runs at the end is killed."""
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, socket.socket(socket.AF_UNIX) as listening:
        path = Path(folder) / "s"
        listening.bind(str(path))
        listening.listen(16)
        shim = commands / "contid"
        client = shlex.join([sys.executable, "-I", "-S", str(CLIENT), str(path)])
        shim.write_text(f'#!/bin/sh\nexec {client} "$@"\n')
        shim.chmod(0o755)
        running: list[tuple[socket.socket, threading.Thread]] = []
        accepting = threading.Thread(target=_accept, args=(listening, running))
        accepting.start()
        try:
            yield
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            accepting.join()
            for connection, thread in running:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
                thread.join()


def _accept(listening: socket.socket, running: list[tuple[socket.socket, threading.Thread]]) -> None:
    while True:
        try:
            connection, _ = listening.accept()
        except OSError:  # it is shut down
            return
        thread = threading.Thread(target=_run, args=(connection,))
        running.append((connection, thread))
        thread.start()


def _run(connection: socket.socket) -> None:
    """One command, from its request to its exit code; it ends with the client that asked for it."""
    with connection:
        received = starter.receive(connection)
        if received is None:
            return
        request, descriptors = received
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "contid", *request["arguments"]],
                cwd=request["folder"],
                env=request["environment"],
                stdin=descriptors[0],
                stdout=descriptors[1],
                stderr=descriptors[2],
                process_group=0,  # a signal to the job of the shell comes once, through the client
            )
        finally:
            for number in descriptors:
                os.close(number)
        ended = os.pidfd_open(process.pid)
        try:
            while ended not in select.select([connection.fileno(), ended], [], [])[0]:
                numbers = connection.recv(16)
                for number in numbers:
                    process.send_signal(number)
                if not numbers:
                    process.kill()
                    break
        finally:
            os.close(ended)
        code = process.wait()
        with suppress(OSError):
            connection.sendall(struct.pack("!i", code))
