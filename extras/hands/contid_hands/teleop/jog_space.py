"""What the keys of a jog move: the tip, the bends of a section, or an axis; and how fast."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Any, Final

from contid.remote.client.described_robot import DescribedRobot
from contid_hands.teleop.jogger import Jogger

#: First speed of a tip [mm/s], and first speed of an axis as a share of its velocity limit.
TIP_MM_S: Final = 10.0
AXIS_SHARE: Final = 0.1
#: Greatest speed of the tip of pneumatic arms, whose axes have a rate of pressure [mm/s]; others have that of
#: their axes.
MAX_TIP_MM_S: Final = 100.0
#: First and greatest speed of a bend [deg/s]; its azimuth turns faster, a length changes by as many mm/s.
BEND_DEG_S: Final = 10.0
MAX_BEND_DEG_S: Final = 60.0
_AZIMUTH_SCALE: Final = 3.0
#: By key: number of its pair, and sign. In tip space the pairs are x, y and z; any moves the chosen axis.
KEYS: Final = {
    "right": (0, 1), "d": (0, 1), "left": (0, -1), "a": (0, -1),
    "up": (1, 1), "w": (1, 1), "down": (1, -1), "s": (1, -1),
    "pageup": (2, 1), "r": (2, 1), "pagedown": (2, -1), "f": (2, -1),
}  # fmt: skip
#: What each pair of keys changes of a section: the first of these columns that the section has.
_OF_SECTION: Final = (("azimuth_deg", "bend_deg"), ("bend_deg",), ("length_mm",))


class Space(enum.StrEnum):
    """What the keys move."""

    TIP = "tip"
    BENDS = "bends"
    AXES = "axes"


#: Field of telemetry in which a jog of each space begins: what was commanded last.
BEGIN: Final = {Space.TIP: "command_tip_mm", Space.BENDS: "bends", Space.AXES: "command"}


class JogSpace:
    """The chosen space of one robot, and the axis and section in it.

    Args:
        robot: the robot.
        axes: begin with the axes.
        tip_mm_s: first speed of the tip [mm/s], at most the greatest; None: see `TIP_MM_S`.

    Attributes:
        space: the chosen one.
        spaces: those to choose from.
        axis, section: index of the chosen one of each.
    """

    def __init__(self, robot: DescribedRobot, axes: bool, tip_mm_s: float | None) -> None:
        self._robot = robot
        self._columns = {Space.TIP: robot.tip, Space.BENDS: robot.bends, Space.AXES: robot.axes}
        self.spaces = [space for space, columns in self._columns.items() if columns]
        self.space = Space.AXES if axes else self.spaces[0]
        self.axis = self.section = 0
        self._greatest = {
            Space.TIP: robot.rates[0] if robot.unit == "mm" else MAX_TIP_MM_S,
            Space.BENDS: MAX_BEND_DEG_S,
            Space.AXES: robot.rates[0],
        }
        self._speeds = {
            Space.TIP: min(tip_mm_s or TIP_MM_S, self._greatest[Space.TIP]),
            Space.BENDS: BEND_DEG_S,
            Space.AXES: AXIS_SHARE * robot.rates[0],
        }

    def go_on(self) -> None:
        """Choose the next space."""
        self.space = self.spaces[(self.spaces.index(self.space) + 1) % len(self.spaces)]

    def choose(self, number: int) -> None:
        """Choose a section while bends are moved, else an axis, by its index; nothing where there is none."""
        if self.space is Space.BENDS:
            # A column is s1.bend_deg, with the name of the robot in front where there are several.
            if any(column.split(".")[-2] == f"s{number + 1}" for column in self._robot.bends):
                self.section = number
        elif number < len(self._robot.axes):
            self.axis, self.space = number, Space.AXES

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns that keys move now."""
        return self._columns[self.space]

    def direction(self, key: str) -> tuple[int, float] | None:
        """Index of the column that a key moves, and the sign; None for a key that moves nothing."""
        if key not in KEYS:
            return None
        pair, sign = KEYS[key]
        if self.space is Space.AXES:
            return self.axis, sign
        if self.space is Space.TIP:
            return (pair, sign) if pair < len(self.columns) else None
        names = [f"s{self.section + 1}.{quantity}" for quantity in _OF_SECTION[pair]]
        found = [index for name in names for index, each in enumerate(self.columns) if each.endswith(name)]
        return (found[0], sign) if found else None

    def begin(self, state: Mapping[str, Any]) -> list[float] | None:
        """Where a motion begins, from telemetry; None before the first command."""
        start = list((state[BEGIN[self.space]] or ())[: len(self.columns)])
        return start if start and None not in start else None

    def jogger(self, start: list[float], hold_s: float) -> Jogger:
        """A jogger of the columns from a beginning; a press moves for ``hold_s``."""
        robot = self._robot
        limits = (robot.minimum, robot.maximum) if self.space is Space.AXES else (None, None)
        return Jogger(
            start,
            *limits,
            speed=self._speeds[self.space],
            max_speed=self._greatest[self.space],
            hold_s=hold_s,
            scales=self._scales(),
        )

    def _scales(self) -> list[float]:
        """Speed of every column as a multiple of the chosen one: a wrist turns in degrees."""
        if self.space is Space.BENDS:
            return [_AZIMUTH_SCALE if "azimuth" in column else 1.0 for column in self.columns]
        if self.space is Space.TIP:
            return [1.0] * len(self.columns)
        return [rates[0] / self._robot.rates[0] for rates in self._robot.axis_rates]

    def change_speed(self, slower: bool, jogger: Jogger | None, hold_s: float) -> None:
        """Make a jogger slower or faster, and those of this space that follow it."""
        changed = jogger or self.jogger([0.0] * len(self.columns), hold_s)
        (changed.slower if slower else changed.faster)()
        self._speeds[self.space] = changed.speed

    def label(self, hold_s: float) -> str:
        """What is moved, how fast, and how far by one press of ``hold_s``; of a section, its bend."""
        speed, unit, which = self._speeds[self.space], "mm", ""
        if self.space is Space.AXES:
            speed, unit = speed * self._scales()[self.axis], self._robot.units[self.axis]
            which = f" {self._robot.axes[self.axis]}"
        elif self.space is Space.BENDS:
            unit, which = "deg", f" s{self.section + 1}"
        return f"{self.space.value}{which}: {speed:.3g} {unit}/s, step {speed * hold_s:.3g} {unit}"
