"""A Rerun recording at its target: a file, a window or a server for the browser."""

from __future__ import annotations

import sys
from typing import Final

import rerun as rr

from contid.robot_file.load import LoadedFile
from contid_view.csp_proxy import LOOPBACK, CspProxy
from contid_view.layout import build_layout
from contid_view.rerun.program import START_TIMEOUT_S, await_port, free_port, start_rerun
from contid_view.rerun.writer import RerunWriter
from contid_view.scene import build_scene
from contid_view.view_target import Kind, ViewError, ViewTarget
from contid_view.window import Window

#: Port of the page, if it is free: the same from run to run.
PAGE_PORT: Final = 9090
#: How much of a run a server keeps for a browser that connects later.
KEPT: Final = "512MiB"


class WebServer:
    """A page, and a server with its data."""

    def __init__(self, *files: str) -> None:
        """Serve files, or the data sent to `data_url`.

        Raises:
            ViewError: it does not start.
        """
        inner, data = free_port(), free_port()
        self.data_url = f"rerun+http://{LOOPBACK}:{data}/proxy"
        ports = ("--web-viewer-port", str(inner), "--port", str(data), "--server-memory-limit", KEPT)
        self._process = start_rerun("--serve-web", *ports, *files)
        try:
            for port in (inner, data):
                await_port(self._process, port)
            self._page = CspProxy(free_port(PAGE_PORT), inner, data)
        except BaseException:
            self._end()
            raise
        self.url = self._page.url

    def wait(self) -> None:
        """Wait until the server ends or an interrupt comes."""
        self._process.wait()

    def close(self) -> None:
        """End the page; a browser keeps what it has loaded."""
        self._page.close()
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()


class RerunSession:
    """A recording at its target with its layout, ready for its `RerunWriter`."""

    def __init__(self, target: ViewTarget, loaded: LoadedFile, rate_hz: float, live: bool) -> None:
        """Open the target.

        Args:
            target: where to draw.
            loaded: the robot file; Rerun stores layouts by its name.
            rate_hz: rate of the ticks.
            live: the robot is running.

        Raises:
            ViewError: the viewer does not start, or the file cannot be written.
        """
        scene = build_scene(loaded, rate_hz)
        self.recording = rr.RecordingStream(f"contid {loaded.file.name}")
        self._path = target.path
        self.server: WebServer | None = None
        self.window: Window | None = None
        layout = build_layout(scene, live=live, finished=not live or target.kind is Kind.FILE)
        try:
            match target.kind:
                case Kind.FILE:
                    assert target.path is not None
                    try:
                        self.recording.save(target.path, default_blueprint=layout)
                    except Exception as error:  # rerun's own classes
                        raise ViewError(f"{target.path}: cannot write it: {error}") from error
                case Kind.SERVE:
                    self.server = WebServer()
                    self.recording.connect_grpc(self.server.data_url, default_blueprint=layout)
                case Kind.SPAWN:
                    self.window = Window()
                    self.recording.connect_grpc(self.window.data_url, default_blueprint=layout)
            rr.set_log_time_enabled(False, recording=self.recording)
            rr.set_log_tick_enabled(False, recording=self.recording)
            self.writer = RerunWriter(self.recording, scene, rate_hz)
        except BaseException:
            if self.server is not None:
                self.server.close()
            raise

    def close(self) -> None:
        """Write what is left; a served page ends, a window stays open."""
        try:
            if self.window is None or self.window.open:
                self.recording.flush(timeout_sec=START_TIMEOUT_S)
        except Exception as error:  # rerun's own classes; a closed viewer is not a failure of the run
            if self._path is not None:
                raise ViewError(f"{self._path}: cannot write it whole: {error}; is the disk full?") from error
            sys.stderr.write(f"contid: the viewer did not take the last frames: {error}\n")
        self.recording.disconnect()
        if self.server is not None:
            self.server.close()
