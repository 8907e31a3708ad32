"""The Rerun side of a picture: a file, a window or a server for the browser; on loopback, silent.

Rerun's servers listen on every interface unless told otherwise, and its viewer reports usage statistics:
neither happens here (``--bind 127.0.0.1``; ``CI=1`` is what Rerun itself takes as "do not report").
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Final

import rerun as rr

from contid.view.layout import build_layout
from contid.view.page import LOOPBACK, Page
from contid.view.picture import Picture
from contid.view.stage import Stage
from contid.view.where import Kind, ViewError, Where

#: Ports that stay the same from run to run, when they are free.
PAGE_PORT: Final = 9090
#: What of a run a server keeps for a browser that comes late.
KEPT: Final = "512MiB"
#: How long a server may take to begin: the program is 300 MB.
PATIENCE_S: Final = 20.0
_PR_SET_PDEATHSIG: Final = 1
_LIBC: Final = ctypes.CDLL(None)


def rerun_program() -> str:
    """Rerun's own program: the command ``rerun`` is a script around it, which would be in the way of signals.

    Raises:
        ViewError: it is not installed.
    """
    found = find_spec("rerun_cli")
    program = Path(found.origin).parent / "rerun" if found is not None and found.origin else Path()
    if not program.is_file():
        raise ViewError("the viewer is not installed: pip install rerun-sdk")
    return str(program)


def free_port(wanted: int = 0) -> int:
    """``wanted`` on loopback if it is free, else any."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise ViewError("no free port on the loopback address")


def start_rerun(*arguments: str, stays: bool = False) -> subprocess.Popen[bytes]:
    """Start the program on loopback, without statistics; with ``stays`` it outlives this process."""
    return subprocess.Popen(
        [rerun_program(), "--bind", LOOPBACK, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=None if stays else _end_with_parent,  # no thread of ours runs yet
        env={**os.environ, "CI": "1"},
    )


def _end_with_parent() -> None:
    """In the new process: be killed when the one that started it ends, however it does."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def await_port(process: subprocess.Popen[bytes], port: int) -> None:
    """Wait until a server that was just started listens.

    Raises:
        ViewError: it ended, or never did.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            raise ViewError(f"the viewer ended at its start with status {process.returncode}")
        with socket.socket() as probe:
            if probe.connect_ex((LOOPBACK, port)) == 0:
                return
        time.sleep(0.05)
    raise ViewError(f"the viewer did not listen on port {port} within {PATIENCE_S:g} s")


class WebServer:
    """A page, and a server with the data it shows."""

    def __init__(self, *files: str) -> None:
        """Serve files, or nothing yet: then data come to `data_url`.

        Raises:
            ViewError: it does not begin.
        """
        inner, data = free_port(), free_port()
        self.data_url = f"rerun+http://{LOOPBACK}:{data}/proxy"
        ports = ("--web-viewer-port", str(inner), "--port", str(data), "--server-memory-limit", KEPT)
        self._process = start_rerun("--serve-web", *ports, *files)
        try:
            for port in (inner, data):
                await_port(self._process, port)
            self._page = Page(free_port(PAGE_PORT), inner, data)
        except BaseException:
            self._end()
            raise
        self.url = self._page.url

    def wait(self) -> None:
        """Until the server ends by itself or an interrupt comes."""
        self._process.wait()

    def close(self) -> None:
        """No page any more; what a browser has loaded it keeps."""
        self._page.close()
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()


class Host:
    """A recording at its place, with its layout, ready for a `Picture`."""

    def __init__(self, where: Where, name: str, stage: Stage, rate_hz: float, live: bool) -> None:
        """Open the place.

        Args:
            where: it is.
            name: of the robot file; layouts are kept by it.
            stage: what there is to draw.
            rate_hz: of the ticks.
            live: the robot is running.

        Raises:
            ViewError: the viewer does not start, or the file cannot be written.
        """
        self.recording = rr.RecordingStream(f"contid {name}")
        self.server: WebServer | None = None
        layout = build_layout(stage, live=live, finished=not live or where.kind is Kind.FILE)
        match where.kind:
            case Kind.FILE:
                assert where.path is not None
                self.recording.save(where.path, default_blueprint=layout)
            case Kind.SERVE:
                self.server = WebServer()
                self.recording.connect_grpc(self.server.data_url, default_blueprint=layout)
            case Kind.SPAWN:
                port = free_port()
                window = start_rerun("--port", str(port), "--hide-welcome-screen", stays=True)
                await_port(window, port)
                url = f"rerun+http://{LOOPBACK}:{port}/proxy"
                self.recording.connect_grpc(url, default_blueprint=layout)
        rr.set_log_time_enabled(False, recording=self.recording)
        rr.set_log_tick_enabled(False, recording=self.recording)
        self.picture = Picture(self.recording, stage, rate_hz)

    def __enter__(self) -> Host:
        """The host itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """See `close`."""
        self.close()

    def close(self) -> None:
        """Write what is left; a served page ends, a window stays."""
        try:
            self.recording.flush(timeout_sec=PATIENCE_S)
        except Exception as error:  # rerun's own classes; a viewer that was closed is no failure of the run
            sys.stderr.write(f"contid: the viewer did not take the last pictures: {error}\n")
        self.recording.disconnect()
        if self.server is not None:
            self.server.close()
