"""One session of teaching on a running daemon: torque off under the lease, then telemetry and keys."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from contid.cli.support.orders import MISSED, UNCONFIRMED
from contid.client import Client
from contid.errors import ContidError
from contid.remote.client.described_robot import DescribedRobot, columns_of
from contid.robot_file.findings import allowed_names
from contid_hands.teach.pose_file import read_pose_file
from contid_hands.teach.pose_store import default_pose_file
from contid_hands.teach.teacher import Teacher
from contid_hands.teleop.keys import Keyboard
from contid_hands.teleop.status_line import with_units

#: The lease lapses this long after the last request.
LEASE_TIMEOUT_S: Final = 2.0
#: Telemetry, and so keys, per second; the rate of recordings.
RATE_HZ: Final = 50.0
#: Period of the line with the present positions.
SHOW_PERIOD_S: Final = 0.1
FIELDS: Final = ("state", "fault", "measured")


class MayHavePowerError(ContidError):
    """A robot that is to be moved by hand may have its full power."""

    exit_code = MISSED


class TeachSession:
    """Teaches some robots of a daemon.

    Args:
        client: connection to the daemon.
        names: names of the robots, each counted once; none: all.
        file: the pose file; None: the one beside the robot file.
        rows_hz: rows per second of recorded trajectories.
        report: called with a line for the operator.

    Attributes:
        robots: that are taught.
        relaxed: those whose torque `relax` switches off.
        file: the pose file.

    Raises:
        ContidError: an unknown robot, or the pose file is wrong.
    """

    def __init__(
        self,
        client: Client,
        names: Sequence[str],
        file: Path | None,
        rows_hz: float,
        report: Callable[[str], None],
    ) -> None:
        self._client = client
        self._report = report
        describe = client.describe()
        known = columns_of(describe)
        for name in names:
            if name not in known:
                raise ContidError(f"no robot {name!r}; {allowed_names(known, name)}")
        self.robots: tuple[DescribedRobot, ...] = tuple(known[name] for name in dict.fromkeys(names or known))
        # The pressures of a pneumatic arm are its pose: venting it would lose what is to be saved.
        self.relaxed = tuple(
            each.robot for each in self.robots if each.unit != "bar" and each.estop == "relax"
        )
        robot_file = Path(describe["file"])
        self.file = file or default_pose_file(robot_file)
        if self.file.exists():
            read_pose_file(self.file)
        elif not self.file.absolute().parent.is_dir():
            raise ContidError(f"{self.file}: there is no folder {self.file.parent}")
        self._teacher = Teacher(self.robots, self.file, robot_file, rows_hz, report)

    def prepare(self, takeover: bool, grip: float | None, keep: bool) -> None:
        """Acquire the lease, then switch the torque off, or lower the current, or keep it.

        The lease keeps others from arming a robot that has hands on it.

        Raises:
            MayHavePowerError: a device did not answer, or a robot has no axis whose current can be lowered.
        """
        self._client.acquire(LEASE_TIMEOUT_S, takeover=takeover)
        if grip is not None:
            limited = self._client.grip(grip, [each.robot for each in self.robots])
            if refused := limited.get("refused"):
                raise MayHavePowerError(f"refused: {'; '.join(refused.values())}; keep your hands off")
            self._report(f"effort limited to {grip:.0%}; move the robots by hand")
        elif not keep and self.relaxed:
            silent = self._client.estop(list(self.relaxed)).get("silent", {})
            if devices := ", ".join(f"{name}.{axis}" for name, axes in silent.items() for axis in axes):
                message = f"{devices} did not answer and may have torque; keep your hands off"
                raise MayHavePowerError(f"{message}; {UNCONFIRMED}")
            self._report(f"{', '.join(self.relaxed)}: torque is off; move the robots by hand")

    def run(self, keyboard: Keyboard, show: Callable[[str], None]) -> None:
        """Until the operator ends or the input ends; a recording in progress is kept.

        Args:
            keyboard: where keys come from.
            show: called with the line of the present state, many times a second.
        """
        shown_s = 0.0
        names = [each.robot for each in self.robots]
        try:
            for frame in self._client.telemetry(RATE_HZ, robots=names, fields=FIELDS):
                self._teacher.take(frame)
                keys = keyboard.keys()
                for key in keys or ():
                    self._teacher.press(key)
                if keys is None or self._teacher.done:
                    return
                if time.monotonic() - shown_s > SHOW_PERIOD_S or keys:
                    shown_s = time.monotonic()
                    show(self._line(frame))
        finally:
            self._teacher.close()

    def _line(self, frame: dict[str, Any]) -> str:
        if self._teacher.asking:
            return self._teacher.asking + self._teacher.typed
        parts = ["RECORDING"] if self._teacher.recording else []
        for each in self.robots:
            robot = frame["robots"][each.robot]
            fault = f" fault {robot['fault']}" if robot["fault"] else ""
            measured = robot["measured"]
            values = with_units(measured, each.units, "8.2f") if measured else "not measured"
            parts.append(f"{each.robot} {robot['state']}{fault} {values}")
        return "  ".join(parts)
