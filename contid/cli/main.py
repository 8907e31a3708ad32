"""The ``contid`` command: a table of commands, each imported only when it is called."""

from __future__ import annotations

import signal
import sys
from contextlib import suppress
from importlib import import_module
from typing import Final, NoReturn

import click

from contid import __version__
from contid.cli.support.streams import finish, stand_in, tell, unwritten
from contid.errors import ContidError

#: Command -> (module that defines it as ``command``, one line for ``contid --help``).
COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "run": ("contid.cli.commands.run", "make the robots follow a trajectory"),
    "status": (
        "contid.cli.commands.status",
        "robots, buses and faults of a running daemon; --watch for a live view",
    ),
    "move": ("contid.cli.commands.move", "send robots of a running daemon to a point, or along a trajectory"),
    "hold": ("contid.cli.commands.hold", "make robots stop and stay where they are"),
    "resume": ("contid.cli.commands.resume", "arm robots and go on with what they followed"),
    "stop": ("contid.cli.commands.stop", "stop robots by the policy of the robot file"),
    "estop": ("contid.cli.commands.estop", "relax or vent robots now"),
    "clear-fault": (
        "contid.cli.commands.clear_fault",
        "look at everything again and leave FAULT; never moves",
    ),
    "fault": ("contid.cli.commands.fault", "what a fault means and what to do"),
    "check": ("contid.cli.commands.check", "validate a robot file and print what it describes"),
    "schema": ("contid.cli.commands.schema", "print the JSON Schema of the robot file"),
    "path": ("contid.cli.commands.path", "print a trajectory: circle, line, square, spiral and others"),
    "fk": ("contid.cli.commands.fk", "actuation rows to tip positions"),
    "ik": ("contid.cli.commands.ik", "target rows to actuation"),
    "shape": (
        "contid.cli.commands.shape",
        "backbone points from actuation rows, or from measured poses of the tip",
    ),
    "replay": (
        "contid.cli.commands.replay",
        "run a recording through today's code and compare every command",
    ),
    "session": ("contid.cli.commands.session", "a recording: summary, export to CSV or .rrd, repair"),
    "view": ("contid.cli.commands.view", "look at a recording: the robots, their axes, what happened"),
    "reach": ("contid.cli.commands.reach", "where the tips can go: areas, volumes, overlaps, plots"),
    "bench": ("contid.cli.commands.bench", "the figures of the documentation, on this machine"),
    "train": ("studies.train", "train the neural network of `contid bench ik`"),
    "emulate": (
        "contid.cli.commands.emulate",
        "wire-level devices on ptys: the real drivers without hardware",
    ),
    "scan": ("contid.cli.commands.scan", "find devices on serial ports"),
    "servo": ("contid.cli.commands.servo", "give a servo its id or baud rate, or restart it"),
    "doctor": ("contid.cli.commands.doctor", "what is wrong with buses and host, and the remedy"),
    "calibrate": ("contid.cli.commands.calibrate", "fit a model's parameters to measurements"),
    "firmware": ("contid.cli.commands.firmware", "build, flash and look at the sketch of the Due boards"),
    "home": ("contid.cli.commands.home", "find the zero of axes and write it into the robot file"),
}


class LazyGroup(click.Group):
    """A group whose help needs none of its commands' imports: ``contid --help`` answers at once."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one command."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(COMMANDS[cmd_name][0]).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table itself is the help."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, line) for name, (_, line) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="contid")
def cli() -> None:
    """Make continuum robots move: one YAML file from geometry to wire."""


def main() -> NoReturn:
    """Run the command line; every `ContidError` becomes one message and its exit code."""
    stand_in()
    try:
        code = finish(_run())
    except KeyboardInterrupt:  # one more, while the end was under way
        code = _interrupted()
    sys.exit(code)


def _interrupted() -> int:
    """The exit code of an orderly end by hand; from here on nothing is left that one more could stop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return 130


def _run() -> int:
    """Run the command that was asked for; its exit code."""
    try:
        cli.main(standalone_mode=False)
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.Abort:
        return _interrupted()
    except click.ClickException as usage:
        with suppress(OSError):
            usage.show()
        return 2
    except ContidError as error:
        tell(str(error))
        return error.exit_code
    except OSError as error:
        # Commands put into words what happens to files they were given; this is mostly the output itself.
        tell(unwritten(error))
        return 2
    except SystemExit as left:
        # Click and Rich end a command whose reader went away (``contid path ... | head``) with 1, which means
        # a failed comparison here. Click leaves this wrapper behind; importing it warns since click 8.4.
        wrapped = type(sys.stdout).__name__.endswith("PacifyFlushWrapper")
        if wrapped or isinstance(left.__context__, BrokenPipeError):
            return 0
        return left.code if isinstance(left.code, int) else int(left.code is not None)
    return 0
