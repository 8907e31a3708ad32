"""What emulated devices received and did: goals of servos, drives and outputs of boards."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_emulate.due import DueEmulator as Board
from contid_emulate.dynamixel.servo import Servo
from tests.campaign.wired.lab_file import TOLERANCE_TICKS

#: Age of what a servo read of itself [s]; ticks that a wire may lose in a row before its robot is in FAULT.
OLD_S: Final = 0.03
AHEAD_TICKS: Final = 2 * TOLERANCE_TICKS
#: Below the first a chamber is empty; by the second a pressure has fallen [Pa].
EMPTY_PA: Final = 3_000.0
FALLEN_PA: Final = 1_000.0
#: What a board's outputs do (firmware/host/README.md).
DRIVES: Final = 2


@dataclass
class ServoProbe:
    """What one servo received: every goal under torque, in ticks of its shaft."""

    servo: Servo
    axis: str
    low: float
    high: float
    wrong: list[str] = field(default_factory=list)
    goals: list[tuple[float, bool, str]] = field(default_factory=list)
    torque_off_s: float = 0.0

    def __post_init__(self) -> None:
        accept = self.servo._accept

        def watched(register: reg.Register, value: int) -> None:
            was = self.servo.torque
            accept(register, value)
            self._saw(register, was)

        self.servo._accept = watched  # type: ignore[method-assign]

    def _saw(self, register: reg.Register, was: bool) -> None:
        servo = self.servo
        # What a host can see: a frozen encoder hides where the shaft is.
        frozen = servo.frozen
        position = servo.position_ticks if frozen is None else frozen - servo.count_offset()
        if register is reg.TORQUE_ENABLE:
            if servo.torque and not was:
                off = abs(servo.motion.goal - position)
                if off > 2.0:
                    self.wrong.append(f"{self.axis}: torque on {off:.0f} ticks away from its goal")
            elif was and not servo.torque:
                self.torque_off_s = time.monotonic()
        elif register is reg.GOAL_POSITION and servo.torque:
            goal = servo.motion.goal
            if not self.low - 1.0 <= goal <= self.high + 1.0:
                self.wrong.append(f"{self.axis}: goal {goal} outside {self.low:.0f}..{self.high:.0f}")
            # To stay where it is brakes, and moves nothing: how a servo is armed again, or left holding. What
            # it read of itself to do so is some milliseconds old.
            here = abs(goal - position) <= 2.0 + OLD_S * abs(servo.motion.velocity)
            where = f"then at {servo.position_ticks:.0f}, {servo.motion.velocity:.0f} ticks/s"
            self.goals.append((goal, here, where))

    def foreign(self, commands: Iterable[float]) -> list[str]:
        """Goals that are no command of the record (device values [rad]), or not in its order."""
        ticks = [value / reg.RAD_PER_TICK for value in commands if value == value]
        at = 0
        for number, (goal, here, where) in enumerate(self.goals):
            found = next((n for n in range(at, len(ticks)) if abs(ticks[n] - goal) <= 1.0), None)
            if found is not None and not (here and found > at + AHEAD_TICKS):
                at = found
            elif not here:
                return [f"{self.axis}: goal {goal:.0f}, number {number}, was not commanded; {where}"]
        return []

    @property
    def powered(self) -> bool:
        return self.servo.torque


@dataclass
class ChannelProbe:
    """What one output of a board did."""

    board: Board
    axis: str
    number: int
    motor: bool
    low: float  # counts, or Pa
    high: float
    speed: float  # largest [counts/s]; of a pressure none is stated
    wrong: list[str] = field(default_factory=list)
    powered: bool = False
    off_s: float = 0.0
    value: float = 0.0
    speed_now: float = 0.0  # [counts/s]
    seen: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=500))

    def look(self) -> None:
        shaft, speed, pressure, _, drive, *_ = map(float, self.board.command(f"get {self.number}").split())
        now_s, now = time.monotonic(), drive == DRIVES
        if self.powered and not now:
            self.off_s = now_s
        self.powered = now
        self.value = shaft if self.motor else pressure
        self.seen.append((now_s, self.value))
        self.speed_now = speed
        if not self.low <= self.value <= self.high:
            self.wrong.append(f"{self.axis}: at {self.value:.0f}, allowed {self.low:.0f}..{self.high:.0f}")
        if self.motor and abs(speed) > self.speed:
            self.wrong.append(f"{self.axis}: {speed:.0f} counts/s, allowed {self.speed:.0f}")


def falls_s(seen: Sequence[tuple[float, float]], since_s: float) -> float:
    """When a pressure first was lower than when the order came."""
    before = max((value for at, value in seen if at <= since_s), default=0.0)
    top = before
    for at, value in seen:
        if at > since_s and top > EMPTY_PA:
            if value < top - FALLEN_PA:
                return at
            top = max(top, value)
    return 0.0
