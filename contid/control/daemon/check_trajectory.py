"""The check of a trajectory for `contid check`: what a run checks before it moves anything."""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Final, TextIO

import numpy as np

from contid.control.daemon.inputs import CancellableReader, Stream, read_file, read_stdin
from contid.control.daemon.terminal import check_progress, print_message
from contid.control.engine.wiring import build_preflight
from contid.control.tick.preflight.rows import TooFastError, Unreachable
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile, load_named
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory, whole_turns

#: Share of rows that repeat the one before, from which on a tracker seems to have held its samples.
_HELD: Final = 0.25


@dataclass(frozen=True, slots=True)
class AcceptedTrajectory:
    """A trajectory that its robots can follow.

    Attributes:
        robot_file: name of the robot file.
        rows: of the trajectory.
        duration_s: from its first row to its last.
        robots: that have columns in it.
    """

    robot_file: str
    rows: int
    duration_s: float
    robots: tuple[str, ...]

    def __str__(self) -> str:
        """One line."""
        rows = "1 row" if self.rows == 1 else f"{self.rows} rows"
        names = " and ".join(self.robots)
        return f"{rows} in {self.duration_s:g} s: within reach and limits of {names} ({self.robot_file})"


def check_trajectory(robot_file: str, trajectory: str, text: TextIO | None = None) -> AcceptedTrajectory:
    """Check a trajectory (``-``: stdin) for a robot file, at the rate of the file.

    Args:
        robot_file: path, or name of a shipped file.
        trajectory: path of a file, or name of ``text``.
        text: the trajectory; None to read the file.

    Raises:
        ContidError: the robot file or the trajectory is wrong, or a robot cannot follow it.
    """
    loaded, source = read_both(robot_file, trajectory, text)
    try:
        check_rows(loaded, source, trajectory)
    except TooFastError as error:
        raise with_remedy(error, source) from error
    moved = tuple(name for name in loaded.driven if name in source.targets_of_row(0))
    return AcceptedTrajectory(loaded.file.name, len(source), source.end_s - source.start_s, moved)


def with_remedy(refused: TooFastError, trajectory: Trajectory) -> TooFastError:
    """The same error; its last finding names the option, or what smooths samples that a tracker held."""
    *others, last = refused.findings
    message = f"{last.message}, or contid run --stretch"
    changes = np.delete(np.diff(trajectory.rows, axis=0), trajectory.layout.time or 0, axis=1)
    repeated = int(np.count_nonzero(~np.any(changes, axis=1)))
    if repeated > _HELD * len(trajectory):
        what = f"{repeated} of {len(trajectory)} rows repeat the one before, as held samples do"
        message += f"; {what}: contid adapt smooths them (smooth_mm)"
    return TooFastError([*others, replace(last, message=message)], refused.slowdown)


def check_rows(loaded: LoadedFile, source: Trajectory, name: str) -> None:
    """Check a trajectory (``-``: stdin) as a run does, at the rate of the file.

    Raises:
        ContidError: a robot cannot follow it; `TooFastError`: only at another pace.
    """
    preflight = build_preflight(loaded, loaded.file.rate_hz, Unreachable.REFUSE)
    assert preflight is not None, "refusing always checks"
    name = "stdin" if name == "-" else name
    preflight.trajectory(source, name, check_progress(len(source)))
    for note in whole_turns(source, name):
        print_message(note)


def read_both(robot_file: str, trajectory: str, text: TextIO | None = None) -> tuple[LoadedFile, Trajectory]:
    """Read a robot file, and a trajectory with times for it; arguments as `check_trajectory`.

    Raises:
        ContidError: the robot file or the trajectory is wrong.
    """
    loaded = load_named(robot_file)
    robots = loaded.driven
    source: Trajectory | Stream
    if text is not None:
        source = read_trajectory(text, trajectory, robots)
    elif trajectory == "-":
        with closing(CancellableReader()) as reader:
            source = read_stdin(sys.stdin, robots, reader)
    else:
        source = read_file(trajectory, robots)
    if isinstance(source, Stream):
        raise ContidError("stdin: no column 't_s': only trajectories with times can be checked as a whole")
    return loaded, source
