"""A gentle motion for any robot file: what `contid demo` shows until control is taken.

Every axis swings around a place near its rest pose, neighbouring axes a third of a period apart: sections of
arms turn around, tips of fingers go along loops. Every row is the nearest actuation that the model allows.
The motion is checked as any trajectory is, and made smaller until it passes.
"""

from __future__ import annotations

import io
import math
from typing import Final

from contid.control.tick.config import RobotConfig
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile
from contid.targets import Actuation, Target
from contid.trajectory.columns import column_groups
from contid.trajectory.read import read_trajectory
from contid_panel.geometry import PanelGeometry

#: Swing of an axis at first, as a share of its range; how it is made smaller, and how often.
SWING: Final = 0.16
SMALLER: Final = 0.6
TRIES: Final = 5
#: Distance from the ends of an axis, in swings: a curve through rows goes a little beyond them.
MARGIN: Final = 0.1
#: Share of the rates of the robot file that the swing needs, and the least period [s].
GENTLE: Final = 0.25
SHORTEST_S: Final = 8.0
#: How long the swing takes to grow from rest [s], its rows per second, and how long the motion goes on [s].
GROWTH_S: Final = 4.0
ROWS_PER_S: Final = 5.0
LASTS_S: Final = 600.0


def demo_motion(loaded: LoadedFile, rate_hz: float) -> str:
    """A trajectory as CSV; "" when even the smallest swing is refused."""
    geometry = PanelGeometry(loaded, rate_hz)
    swing = SWING
    for _ in range(TRIES):
        motion = _Motion(loaded, [robot.config for robot in geometry.scene.robots], swing)
        text = motion.csv(GROWTH_S + motion.period_s)
        try:
            trajectory = read_trajectory(io.StringIO(text), "demo", loaded.driven)
            geometry.preflight({}).trajectory(trajectory, "demo")
        except ContidError:
            swing *= SMALLER
        else:
            return motion.csv(LASTS_S)
    return ""


class _Motion:
    """One swing of all robots of a file."""

    def __init__(self, loaded: LoadedFile, configs: list[RobotConfig], swing: float) -> None:
        several = len(loaded.driven) > 1
        self._configs, self._swing = configs, swing
        self._columns = ["t_s"]
        for config in configs:
            groups = column_groups(f"{config.name}." if several else "", loaded.driven[config.name])
            self._columns += [*groups.get("actuation", []), *groups.get("extra", [])]
        self.period_s = max(SHORTEST_S, *(self._slowest_s(config) for config in configs))

    def _slowest_s(self, config: RobotConfig) -> float:
        """The shortest period that stays within a share of all rates."""
        found = 0.0
        for axis, (low, high) in enumerate(zip(config.model.lower, config.model.upper, strict=True)):
            size = self._swing * (high - low)
            for order, rates in enumerate((config.velocity, config.acceleration, config.jerk), start=1):
                found = max(found, 2.0 * math.pi * (size / (GENTLE * rates[axis])) ** (1.0 / order))
        return found

    def csv(self, lasts_s: float) -> str:
        """Its rows from rest on."""
        lines = [",".join(self._columns)]
        for number in range(math.ceil(lasts_s * ROWS_PER_S) + 1):
            t_s = number / ROWS_PER_S
            row = [t_s]
            for place, config in enumerate(self._configs):
                at = self._at(config, t_s, place)
                row += [value * each.per_si for value, each in zip(at, config.quantities, strict=True)]
            lines.append(",".join(f"{value:.12g}" for value in row))
        return "\n".join(lines) + "\n"

    def _at(self, config: RobotConfig, t_s: float, place: int) -> Actuation:
        """Axes of a robot at a time, within the limits that couple them."""
        share = min(t_s / GROWTH_S, 1.0)
        grown = share * share * share * (10.0 + share * (6.0 * share - 15.0))
        own = len(config.axis_names) - config.extra_axes
        values = list(config.rest)
        for axis in range(own):
            low, high = config.model.lower[axis], config.model.upper[axis]
            size = self._swing * (high - low)
            room = (1.0 + MARGIN) * size
            middle = min(max(config.rest[axis], low + room), high - room)
            turn = 2.0 * math.pi * (t_s / self.period_s - axis / 3.0 - place / 2.0 - 0.17 * (axis // 3))
            begin = min(max(config.rest[axis], low + MARGIN * size), high - MARGIN * size)
            values[axis] = begin + grown * (middle + size * math.sin(turn) - begin)
        inside = config.model.inverse(Target(actuation=tuple(values[:own])), tuple(values))
        return (*inside.actuation[:own], *values[own:])
