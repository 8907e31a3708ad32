"""The ``contid`` command: a table of the core's commands, each imported only when it is called."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from typing import Final, NoReturn

import click

from contid import __version__
from contid.cli.support.streams import flush_stdout, open_closed_streams, print_error, system_error_message
from contid.cli.support.table import TableGroup
from contid.errors import ContidError, missing_extra

_ORDERS: Final = "contid.cli.commands.orders"

#: Command -> (module[:attribute], one line for ``contid --help``).
COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "run": ("contid.cli.commands.run", "make the robots follow a trajectory"),
    "status": (
        f"{_ORDERS}:status",
        "robots, buses and faults of a running daemon; --watch for a live view",
    ),
    "move": ("contid.cli.commands.move", "send robots of a running daemon to a point, or along a trajectory"),
    "hold": (f"{_ORDERS}:hold", "stop robots and keep them where they are"),
    "resume": (f"{_ORDERS}:resume", "arm robots and continue with what they followed"),
    "stop": (f"{_ORDERS}:stop", "stop robots by the policy of the robot file"),
    "estop": (f"{_ORDERS}:estop", "relax or vent robots now"),
    "recover": (f"{_ORDERS}:recover", "move robots outside their limits inside, slowly"),
    "clear-fault": (f"{_ORDERS}:clear_fault", "re-check all devices and leave FAULT; never moves"),
    "check": ("contid.cli.commands.check", "validate a robot file, or a trajectory for it; moves nothing"),
}

#: Headings of ``contid --help``; commands of extras stand here where they serve the same purpose.
SECTIONS: Final = {
    "Operate": [
        "run", "status", "move", "hold", "resume", "stop", "estop", "recover", "clear-fault", "fault",
    ],
    "Describe": ["new", "check", "schema"],
    "Analyse": ["path", "retime", "fk", "ik", "shape", "replay", "session"],
    "Maintain": ["scan", "doctor", "bringup", "home", "servo", "firmware"],
}  # fmt: skip

cli = click.version_option(__version__, prog_name="contid")(
    TableGroup(
        COMMANDS,
        "Commands",
        sections=SECTIONS,
        name="cli",
        help="Make continuum robots move: one YAML file from geometry to wire.",
        context_settings={"help_option_names": ["-h", "--help"]},
    )
)


def main() -> NoReturn:
    """Run the command line; every `ContidError` becomes one message and its exit code."""
    open_closed_streams()
    try:
        code = flush_stdout(_run())
    except KeyboardInterrupt:  # a further Ctrl-C during the exit
        code = _interrupted()
    sys.exit(code)


def _interrupted() -> int:
    """The exit code after Ctrl-C; further ones are ignored."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return 130


def _run() -> int:
    """Run the command; its exit code."""
    try:
        cli.main(standalone_mode=False)
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.Abort as aborted:
        if isinstance(aborted.__cause__ or aborted.__context__, EOFError):
            print_error("stdin ended where an answer was expected; give the answers, or a terminal")
            return 2
        return _interrupted()
    except click.ClickException as usage:
        with suppress(OSError):
            usage.show()
        return 2
    except ContidError as error:
        print_error(str(error))
        return error.exit_code
    except ModuleNotFoundError as error:
        missing = missing_extra(error, f"contid {sys.argv[1]}" if sys.argv[1:] else "contid")
        if missing is None:
            raise
        print_error(str(missing))
        return missing.exit_code
    except OSError as error:
        # Commands convert the errors of files they were given; what arrives here is mostly the output itself.
        print_error(system_error_message(error))
        return 2
    except SystemExit as request:
        # Click and Rich exit with 1 when the reader closed the pipe (``contid path ... | head``); 1 means a
        # failed comparison here. Click leaves this wrapper behind; importing it warns since click 8.4.
        wrapped = type(sys.stdout).__name__.endswith("PacifyFlushWrapper")
        if wrapped or isinstance(request.__context__, BrokenPipeError):
            return 0
        return request.code if isinstance(request.code, int) else int(request.code is not None)
    return 0
