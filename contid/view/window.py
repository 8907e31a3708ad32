"""A window of the native viewer: opened, watched while it opens, and left to whoever looks at it."""

from __future__ import annotations

import re
import tempfile
import time
from typing import Final

from contid.view.csp_proxy import LOOPBACK
from contid.view.rerun_program import await_port, free_port, start_rerun
from contid.view.view_target import ViewError

#: The program listens at once; whether graphics and display are good enough turns out up to so much later.
OPENING_S: Final = 3.0
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*m")


class Window:
    """One window."""

    def __init__(self, *files: str) -> None:
        """Open it, with files or with what comes to `data_url`.

        Raises:
            ViewError: it does not open.
        """
        port = free_port()
        self.data_url = f"rerun+http://{LOOPBACK}:{port}/proxy"
        with tempfile.TemporaryFile() as message:
            arguments = ("--port", str(port), "--hide-welcome-screen", *files)
            self._process = start_rerun(*arguments, stays=True, message=message)
            try:
                await_port(self._process, port)
                deadline_s = time.monotonic() + OPENING_S
                while time.monotonic() < deadline_s:
                    if not self.open:
                        raise ViewError(f"the viewer ended with status {self._process.returncode}")
                    time.sleep(0.05)
            except ViewError as error:
                self._process.kill()
                self._process.wait()
                message.seek(0)
                why = _reason(message.read().decode(errors="replace"))
                raise ViewError(
                    f"no window: {why or error}; a page for a browser (serve) or a file needs no display"
                ) from None

    @property
    def open(self) -> bool:
        """False when somebody closed it."""
        return self._process.poll() is None


def _reason(message: str) -> str:
    """The last error a program told, without its colours and its web addresses; empty when it told none."""
    told = [line for line in _COLOURS.sub("", message).splitlines() if line.startswith("Error: ")]
    return told[-1].removeprefix("Error: ").partition(" Check the ")[0].rstrip(".") if told else ""
