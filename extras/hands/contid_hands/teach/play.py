"""Playing a sequence of poses on a running daemon, step by step, under its limits and its lease.

The lease is held from the first step to the last: a sequence that has lost it ends, also where a person let
the robots go on meanwhile. Who stops robots and arms them again does not expect them to move.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from contid.client import Client, Code, RemoteError
from contid.errors import BadInputError, ContidError
from contid.remote.client.described_robot import columns_of
from contid.remote.client.move_arguments import columns_and_rows
from contid.robot_file.positions import KeyPath
from contid.trajectory.lines import NO_TIMES
from contid_hands.teach.check_targets import check_targets
from contid_hands.teach.pose_file import PoseFile, SequenceStep
from contid_paths.bends import between
from contid_paths.shapes import minimum_jerk

#: Period of the looks at the lease during a wait, which keep it; it lapses after two seconds.
LOOK_PERIOD_S: Final = 0.25
#: Rows of a motion with a time: the daemon lays a smooth curve through them.
ROWS_PER_S: Final = 25.0
MIN_ROWS: Final = 16
MAX_ROWS: Final = 2000
#: Of a lease that another client, or time, has ended.
LOST: Final = "the lease was lost, so that the robots were held, and perhaps moved, by others"
#: Columns of a robot, and the field of telemetry with what was commanded of them last.
_BEGIN: Final = {"axes": "command", "tip": "command_tip_mm", "bends": "bends"}


class StepRefusedError(ContidError):
    """A step that the daemon refused or that was stopped, with its place in the file."""

    def __init__(self, where: str, error: RemoteError) -> None:
        super().__init__(f"{where}: {error}")
        self.exit_code = error.exit_code


class Player:
    """Plays the steps of a pose file.

    Args:
        client: connection to the daemon.
        file: the poses.
        report: called with a line about each step.

    Raises:
        BadInputError: poses of ``names`` or of the sequence do not suit the robots, or a trajectory has no
            times; nothing has moved.
        ContidError: no such pose, or a trajectory cannot be read.
    """

    def __init__(
        self, client: Client, file: PoseFile, names: Sequence[str], report: Callable[[str], None]
    ) -> None:
        self._client = client
        self._file = file
        self._report = report
        self._last: dict[str, float] = {}
        self._begun = False
        self._describe = client.describe()
        self._steps = tuple(SequenceStep(pose=name) for name in names) or file.contents.sequence
        if not self._steps:
            message = "has no `sequence:`; add one, or name poses: contid play FILE POSE..."
            raise ContidError(f"{file.path}: {message}")
        used = {*names} or {step.pose for _, step in file.located_steps() if step.pose is not None}
        for name in sorted(used):
            file.pose(name)
        check_targets(file, self._describe, used)
        self._given = bool(names)
        #: Columns and rows by the path of each trajectory, read before anything moves.
        self._rows: dict[str, tuple[list[str], list[list[float]]]] = {}
        for path, step in () if names else file.located_steps():
            if step.trajectory is not None and step.trajectory not in self._rows:
                self._rows[step.trajectory] = self._read(step.trajectory, path)

    def play(self, repeat: int) -> None:
        """Do all steps ``repeat`` times, 0 for ever.

        Raises:
            StepRefusedError: the daemon refused a step, or the robots were stopped.
            ConnectionLostError: the daemon is gone.
        """
        count = 0
        while not repeat or count < repeat:
            count += 1
            self._play(("sequence",), self._steps)

    def _play(self, path: KeyPath, steps: Sequence[SequenceStep]) -> None:
        for number, step in enumerate(steps):
            here = (*path, number)
            for _ in range(step.loop or 0):
                self._play((*here, "steps"), step.steps or ())
            try:
                self._keep_lease()
                self._one(step)
            except RemoteError as error:
                raise StepRefusedError(self._where(here, step), error) from None

    def _where(self, path: KeyPath, step: SequenceStep) -> str:
        if self._given:  # a step of the command line has no place in the sequence
            path = ("poses", str(step.pose))
        found = self._file.document.at_key(path, "")
        what = f"pose {step.pose!r}" if step.pose else step.trajectory or "wait"
        return f"{found.file}:{found.line}:{found.column}: {what}"

    def _one(self, step: SequenceStep) -> None:
        if step.pose is not None:
            target = self._file.pose(step.pose).target
            if step.time_s is None:
                self._report(f"pose {step.pose}")
                self._client.move(target)
            else:
                self._report(f"pose {step.pose} in {step.time_s:g} s")
                columns, rows = self.timed(target, step.time_s)
                self._stream(columns, rows)
            self._last = dict(target)
        elif step.trajectory is not None:
            self._report(f"trajectory {step.trajectory}")
            self._trajectory(step.trajectory)
        if step.wait_s:
            self._report(f"wait {step.wait_s:g} s")
            self._wait(step.wait_s)

    def timed(self, target: Mapping[str, float], time_s: float) -> tuple[list[str], list[list[float]]]:
        """Columns and rows of a minimum-jerk motion to a target (Flash and Hogan 1985, equation 6)."""
        start = self._last if self._last.keys() == target.keys() else self._present(target)
        count = round(min(max(ROWS_PER_S * time_s, MIN_ROWS), MAX_ROWS))
        rows = []
        for number in range(count + 1):
            s = number / count
            rows.append([s * time_s, *between(start, target, minimum_jerk(s))])
        return ["t_s", *target], rows

    def _present(self, target: Mapping[str, float]) -> dict[str, float]:
        """Commanded values of the columns of a target; other inputs, as loads, begin at their target."""
        frames = self._client.telemetry(fields=tuple(_BEGIN.values()))
        robots = next(frames)["robots"]
        frames.close()
        present = dict(target)
        for name, columns in columns_of(self._describe).items():
            for group, field in _BEGIN.items():
                for column, value in zip(getattr(columns, group), robots[name][field] or (), strict=False):
                    for key in (column, column.removeprefix(f"{name}."), f"{name}.{column}"):
                        if key in present and value is not None and math.isfinite(value):
                            present[key] = value
        return present

    def _trajectory(self, name: str) -> None:
        self._stream(*self._rows[name])
        self._last = {}

    def _read(self, name: str, key: KeyPath) -> tuple[list[str], list[list[float]]]:
        """Columns and rows of a trajectory; ``key`` is that of its step."""
        path = self._file.path.parent / name
        try:
            with path.open(encoding="utf-8") as file:
                columns, rows = columns_and_rows(file)
                if "t_s" not in columns:
                    raise BadInputError([self._file.document.at_key(key, f"{path}: {NO_TIMES}")])
                return columns, list(rows)
        except (OSError, UnicodeDecodeError) as error:
            raise ContidError(f"{path}: cannot be read: {error}") from error

    def _stream(self, columns: list[str], rows: list[list[float]]) -> None:
        if refused := self._client.stream(columns, rows):
            raise RemoteError(Code.BAD_TARGET, f"refused: {'; '.join(refused)}")

    def _wait(self, seconds: float) -> None:
        """Wait and keep the lease."""
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0.0:
            self._keep_lease()
            time.sleep(min(LOOK_PERIOD_S, left_s))

    def _keep_lease(self) -> None:
        """Acquire the lease before the first step, and keep it.

        Raises:
            RemoteError: it is lost: another client stopped the robots or took over, or this one stood still.
        """
        if not self._begun:
            self._client.request("acquire", unless_stopped=True)
            self._begun = True
            return
        lease = self._client.status()["lease"]
        if lease.get("client") != self._client.hello["client"]:
            why = f"{lease['stopped_by']} stopped the robots" if lease.get("stopped_by") else LOST
            raise RemoteError(Code.STOPPED, f"{why}; the sequence ends")
