"""The options that this extra adds to `contid run`: a page beside the run."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final

import click

from contid.cli.support.added_options import Watch
from contid.errors import require_extra


@contextmanager
def panel_process(socket: Path, opens: bool, demonstrates: bool) -> Iterator[None]:
    """`contid panel` for the daemon at a socket, also before it listens; it ends with the run.

    Args:
        socket: of the daemon, which never waits for the panel.
        opens: a browser is opened.
        demonstrates: the input of the run is a demonstration; pages take over without a question.
    """
    from contid.control.daemon.spawn import module_command
    from contid_library.process_beside import process_beside

    command = module_command("contid", "panel", "--socket", str(socket), "--wait")
    with process_beside(command + ["--open"] * opens + ["--demo"] * demonstrates, subprocess.DEVNULL):
        yield


class PanelOption:
    """The panel as a process beside a run; see `contid.cli.support.added_options.RunOption`."""

    options = (
        click.Option(
            ["--panel"],
            is_flag=True,
            help="Serve a page that shows and moves the robots; prints its URL.",
        ),
        click.Option(["--panel-open"], is_flag=True, hidden=True, help="The same, and open a browser."),
        click.Option(["--panel-demo"], is_flag=True, hidden=True, help="The input is a demonstration."),
    )

    def prepare(self, values: Mapping[str, Any], virtual: bool) -> Watch | None:
        """Refuse a panel that cannot be, before the run starts; None without a panel.

        Raises:
            click.UsageError: the run is in virtual time.
            ContidError: a package of the extra is missing.
        """
        if not (values.get("panel") or values.get("panel_open")):
            return None
        if virtual:
            raise click.UsageError("--panel needs a daemon in real time; --virtual has no socket")
        require_extra("the panel", "starlette", "uvicorn", "websockets")
        return Watch(
            beside=partial(
                panel_process,
                opens=bool(values.get("panel_open")),
                demonstrates=bool(values.get("panel_demo")),
            )
        )


PANEL: Final = PanelOption()
