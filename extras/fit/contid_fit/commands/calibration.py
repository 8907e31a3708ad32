"""Shared by the calibrations: measurements, robot, figure, and writing back."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TextIO, TypeVar

import click

from contid.cli.support.parameters import CHANGED_FILE, FIGURE
from contid.errors import ContidError

if TYPE_CHECKING:
    from contid.robot_file.edit import Change
    from contid.robot_file.robot import RobotDescription

    _Kind = TypeVar("_Kind", bound=RobotDescription)


#: A table of measurements; spreadsheets write a mark before its first line.
MEASUREMENTS: Final = click.File("r", encoding="utf-8-sig")


def source_of(data: TextIO) -> str:
    """Name of measurements in messages."""
    name: str = getattr(data, "name", "<stdin>")
    return "stdin" if name == "<stdin>" else name


def lines_of(data: TextIO) -> Iterator[str]:
    """Lines of measurements.

    Raises:
        ContidError: the file is no text.
    """
    try:
        yield from data
    except UnicodeDecodeError as error:
        raise ContidError(f"{source_of(data)}: not a table in UTF-8 text ({error.reason})") from None


@dataclass(frozen=True, slots=True)
class Calibration:
    """The arguments of one calibration.

    Attributes:
        data: the measurements.
        robot_file: file with the dimensions.
        robot: name of the robot; None when the file has one of the kind.
        write: the robot file to write the fit into, or None.
        plot: the figure to write, or None.
        as_json: print JSON instead of text.
    """

    data: TextIO
    robot_file: str
    robot: str | None
    write: Path | None
    plot: Path | None
    as_json: bool

    @property
    def source(self) -> str:
        """Name of the measurements in messages."""
        return source_of(self.data)

    @property
    def lines(self) -> Iterator[str]:
        """Of the measurements."""
        return lines_of(self.data)

    @property
    def note(self) -> str:
        """Origin of the numbers: the comment behind each."""
        # A line break would end the comment, and YAML has no bytes that are not text.
        file = "".join(each if each.isprintable() else "?" for each in Path(self.source).name)
        return f"calibrated {date.today().isoformat()} from {file}"

    def find(self, kind: type[_Kind], kind_name: str) -> tuple[str, _Kind]:
        """Name and description of the robot; ``kind_name`` is for messages."""
        from contid_fit.calibrate.target_robot import find_robot

        return find_robot(self.robot_file, self.robot, kind, kind_name)

    def write_back(self, robot: str, changes: Sequence[Change], measured: Sequence[str] = ()) -> None:
        """Write the numbers into the robot file, with ``--write``; ``measured``: placeholders they fill."""
        from contid_fit.calibrate.target_robot import write_back

        if self.write is not None:
            write_back(self.write, robot, changes, measured)
            click.echo(f"written to {self.write}", err=True)


def calibration(name: str) -> Callable[[Callable[..., None]], click.Command]:
    """The command ``contid calibrate NAME`` from a function of a `Calibration` and its own options."""

    def decorate(function: Callable[..., None]) -> click.Command:
        @click.command(name=name)
        @click.argument("data", type=MEASUREMENTS)
        @click.option(
            "--for", "robot_file", help="Robot file (or the name of a shipped one) with the dimensions."
        )
        @click.option(
            "--write",
            type=CHANGED_FILE,
            help="Robot file to take the dimensions from and to write the fit into.",
        )
        @click.option("--robot", help="Which robot, where the file has several.")
        @click.option("--plot", type=FIGURE, help="Write a figure (.png, .svg or .pdf).")
        @click.option("--json", "as_json", is_flag=True, help="One JSON object per fit.")
        @functools.wraps(function)
        def command(
            data: TextIO,
            robot_file: str | None,
            write: Path | None,
            robot: str | None,
            plot: Path | None,
            as_json: bool,
            **own: Any,
        ) -> None:
            if (robot_file is None) == (write is None):
                raise click.UsageError(
                    "name the robot's file: --write FILE to change it, --for FILE to only read it"
                )
            request = Calibration(data, str(write or robot_file), robot, write, plot, as_json)
            function(request, **own)

        return command

    return decorate
