"""A window of the native Rerun viewer: a process of its own, which stays open when this one ends."""

from __future__ import annotations

import re
import subprocess
import tempfile
from contextlib import suppress
from typing import Final

from contid_view.csp_proxy import LOOPBACK
from contid_view.rerun.program import await_port, free_port, start_rerun
from contid_view.view_target import ViewError

#: The program opens its port at once; without graphics or a display it ends up to this much later [s].
OPENING_S: Final = 3.0
#: Escape sequences that colour the output of a program.
_COLOURS: Final = re.compile(r"\x1b\[[0-9;]*m")


class Window:
    """One window.

    Args:
        files: recordings to show; without any it shows what is sent to ``data_url``.

    Attributes:
        data_url: address at which the window takes data.

    Raises:
        ViewError: the window does not open.
    """

    def __init__(self, *files: str) -> None:
        port = free_port()
        self.data_url = f"rerun+http://{LOOPBACK}:{port}/proxy"
        with tempfile.TemporaryFile() as errors:
            arguments = ("--port", str(port), "--hide-welcome-screen", *files)
            self._process = start_rerun(*arguments, outlives=True, stderr=errors)
            try:
                await_port(self._process, port)
                with suppress(subprocess.TimeoutExpired):
                    status = self._process.wait(OPENING_S)
                    raise ViewError(f"the viewer ended with status {status}")
            except ViewError as error:
                self._process.kill()
                self._process.wait()
                errors.seek(0)
                reason = _last_error(errors.read().decode(errors="replace"))
                raise ViewError(
                    f"no window: {reason or error}; a page for a browser (serve) or a file needs no display"
                ) from None

    @property
    def open(self) -> bool:
        """False once the window was closed."""
        return self._process.poll() is None


def _last_error(output: str) -> str:
    """The last error in a program's output, without colours and web addresses; "" without one."""
    errors = [line for line in _COLOURS.sub("", output).splitlines() if line.startswith("Error: ")]
    return errors[-1].removeprefix("Error: ").partition(" Check the ")[0].rstrip(".") if errors else ""
