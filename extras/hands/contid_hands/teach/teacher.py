"""Teaching by hand: telemetry and keys to saved poses and recorded motions. No I/O but files.

Keys: ``s`` saves the present pose under a name, ``r`` begins and ends a recording, ``q`` ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from contid.errors import ContidError, RecordingStoppedError
from contid.remote.client.described_robot import DescribedRobot
from contid.whole_file import replacing
from contid_hands.teach.pose_file import read_pose_file
from contid_hands.teach.pose_store import provenance, save_pose
from contid_hands.teach.present_pose import present_pose
from contid_hands.teach.recording import RecordedLimits, taught_motion, trajectory_csv

HELP: Final = "s save pose, r record / end recording, q quit"
#: Half an hour at 50 Hz.
MAX_SAMPLES: Final = 90_000


class Teacher:
    """Saves poses and motions of robots that are moved by hand.

    Args:
        robots: those that are taught.
        file: the pose file.
        robot_file: text of the robot file, for the provenance.
        rows_hz: rows per second of recorded trajectories.
        report: called with a line for the operator.

    Attributes:
        done: the operator wants to end.
        asking: the question on the line of input, "" when there is none.
        typed: the answer typed so far.
    """

    def __init__(
        self,
        robots: Sequence[DescribedRobot],
        file: Path,
        robot_file: Path,
        rows_hz: float,
        report: Callable[[str], None],
    ) -> None:
        self._robots = tuple(robots)
        self._file = file
        self._robot_file = robot_file
        self._rows_hz = rows_hz
        self._report = report
        self._columns = tuple(column for robot in robots for column in robot.axes)
        self._newest: tuple[float, list[float]] | None = None
        self._asked: tuple[float, list[float]] | None = None
        self._samples: list[tuple[float, list[float]]] | None = None
        self.done = False
        self.asking = self.typed = ""

    @property
    def recording(self) -> bool:
        """A motion is being recorded."""
        return self._samples is not None

    def take(self, frame: Mapping[str, Any]) -> None:
        """Take in a telemetry frame."""
        values: list[float] = []
        for robot in self._robots:
            measured = frame["robots"][robot.robot]["measured"]
            if measured is None or not np.isfinite(measured).all():
                self._newest = None
                return
            values += measured
        self._newest = float(frame["t_s"]), values
        if self._samples is not None and len(self._samples) < MAX_SAMPLES:
            self._samples.append(self._newest)
            if len(self._samples) == MAX_SAMPLES:
                self._report("the recording is full; it ends here")
                self._end_recording()

    def press(self, key: str) -> None:
        """Take in a key."""
        if self.asking:
            self._answer(key)
        elif key == "s" and self._newest is None:
            self._report("not every axis has been read; look at contid status")
        elif key == "s":
            self._asked = self._newest  # the pose at the key, whatever moves while the name is typed
            self.asking = f"name of the pose [{self._free_name('pose')}]: "
        elif key == "r" and self._samples is None:
            self._samples = []
            self._report("recording; r ends it")
        elif key == "r":
            self._end_recording()
        elif key in ("q", "escape"):
            self.done = True
        elif key not in ("enter", "space"):
            self._report(HELP)

    def close(self) -> None:
        """Keep a recording that was not ended.

        Raises:
            RecordingStoppedError: it could not be written.
        """
        if self._samples is not None:
            self._end_recording()
        if self._samples is not None:
            raise RecordingStoppedError(f"a motion of {len(self._samples)} samples is lost")

    def _answer(self, key: str) -> None:
        if key == "enter":
            name, self.asking, self.typed = self.typed or self._free_name("pose"), "", ""
            self._save(name)
        elif key == "escape":
            self.asking = self.typed = ""
            self._report("not saved")
        elif key == "backspace":
            self.typed = self.typed[:-1]
        elif key == "space" or len(key) == 1:
            self.typed += " " if key == "space" else key

    def _save(self, name: str) -> None:
        assert self._asked is not None
        target, messages = present_pose(self._robots, self._asked[1])
        for message in messages:
            self._report(message)
        saved = provenance(self._robot_file, "contid teach")
        try:
            replaced = save_pose(self._file, name, target, saved, self._robot_file.name)
        except ContidError as error:
            self._report(str(error))
            return
        shown = ", ".join(f"{column} {value:.2f}" for column, value in target.items())
        self._report(f"{'replaced' if replaced else 'saved'} {name}: {shown}")

    def _end_recording(self) -> None:
        """Smooth the recorded motion and write it beside the pose file; it is kept where that fails."""
        samples, self._samples = self._samples or [], None
        limits = RecordedLimits(
            np.array([low for robot in self._robots for low in robot.minimum]),
            np.array([high for robot in self._robots for high in robot.maximum]),
            np.array([rates for robot in self._robots for rates in robot.axis_rates]).T,
        )
        times_s = np.array([time for time, _ in samples])
        positions = np.array([values for _, values in samples]).reshape(len(samples), len(self._columns))
        path = self._file.with_name(f"{self._free_name('motion')}.csv")
        try:
            motion = taught_motion(times_s, positions, limits, self._rows_hz)
        except ContidError as error:
            self._report(f"not recorded: {error}")
            return
        saved = provenance(self._robot_file, f"contid teach, {len(samples)} samples")
        try:
            with replacing(path) as file:
                file.write(trajectory_csv(self._columns, motion, saved).encode())
        except ContidError as error:
            self._samples = samples
            self._report(f"{error}; the recording goes on, r ends it")
            return
        notes = f", {motion.slower:.2f} times slower than the hand" if motion.slower > 1.0 else ""
        notes += f", {motion.clipped} samples outside the limits" if motion.clipped else ""
        self._report(f"recorded {path}: {motion.times_s[-1]:.1f} s, {len(motion.times_s)} rows{notes}")

    def _free_name(self, stem: str) -> str:
        """``pose1``, ``motion1`` or the next number that is free."""
        taken: set[str] = set()
        with suppress(ContidError):  # none yet, or one that was broken meanwhile: saving reports that
            taken = set(read_pose_file(self._file).contents.poses)
        number = 1
        while f"{stem}{number}" in taken or self._file.with_name(f"{stem}{number}.csv").exists():
            number += 1
        return f"{stem}{number}"
