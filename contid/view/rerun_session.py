"""The Rerun side of a picture: a file, a window or a server for the browser."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Final

import rerun as rr

from contid.view.csp_proxy import LOOPBACK, CspProxy
from contid.view.layout import build_layout
from contid.view.rerun_program import PATIENCE_S, await_port, free_port, start_rerun
from contid.view.rerun_writer import RerunWriter
from contid.view.stage import Stage
from contid.view.view_target import Kind, ViewError, ViewTarget
from contid.view.window import Window

#: Ports that stay the same from run to run, when they are free.
PAGE_PORT: Final = 9090
#: What of a run a server keeps for a browser that comes late.
KEPT: Final = "512MiB"


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
            self._page = CspProxy(free_port(PAGE_PORT), inner, data)
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


class RerunSession:
    """A recording at its place, with its layout, ready for a `RerunWriter`."""

    def __init__(self, where: ViewTarget, name: str, stage: Stage, rate_hz: float, live: bool) -> None:
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
        self._path = where.path
        self.server: WebServer | None = None
        self.window: Window | None = None
        layout = build_layout(stage, live=live, finished=not live or where.kind is Kind.FILE)
        match where.kind:
            case Kind.FILE:
                assert where.path is not None
                try:
                    self.recording.save(where.path, default_blueprint=layout)
                except Exception as error:  # rerun's own classes
                    raise ViewError(f"{where.path}: cannot write it: {error}") from error
            case Kind.SERVE:
                self.server = WebServer()
                self.recording.connect_grpc(self.server.data_url, default_blueprint=layout)
            case Kind.SPAWN:
                self.window = Window()
                self.recording.connect_grpc(self.window.data_url, default_blueprint=layout)
        rr.set_log_time_enabled(False, recording=self.recording)
        rr.set_log_tick_enabled(False, recording=self.recording)
        self.picture = RerunWriter(self.recording, stage, rate_hz)

    def __enter__(self) -> RerunSession:
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
            if self.window is None or self.window.open:
                self.recording.flush(timeout_sec=PATIENCE_S)
        except Exception as error:  # rerun's own classes; a viewer that was closed is no failure of the run
            if self._path is not None:
                raise ViewError(f"{self._path}: cannot write it whole: {error}; is the disk full?") from error
            sys.stderr.write(f"contid: the viewer did not take the last pictures: {error}\n")
        self.recording.disconnect()
        if self.server is not None:
            self.server.close()
