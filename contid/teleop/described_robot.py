"""Columns, limits and rates of the robots of a running daemon, from its ``describe``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class DescribedRobot:
    """The columns of one robot as a trajectory names them.

    Attributes:
        robot: its name.
        axes: columns of its axes, in their order.
        minimum, maximum: limits of the axes, in their units.
        tip: columns of its tip.
        unit: of its axes: mm or bar.
        rates: greatest velocity, acceleration and jerk of its axes [unit/s, unit/s^2, unit/s^3].
        estop: what `estop` does with it: relax, vent or another policy.
    """

    robot: str
    axes: tuple[str, ...]
    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    tip: tuple[str, ...]
    unit: str
    rates: tuple[float, float, float]
    estop: str


def columns_of(describe: Mapping[str, Any]) -> dict[str, DescribedRobot]:
    """The columns of every robot; names in front only when there are several robots."""
    robots = describe["robots"]
    found = {}
    for name, robot in robots.items():
        prefix = f"{name}." if len(robots) > 1 else ""
        unit = robot["unit"]
        limits = robot["axes"]
        found[name] = DescribedRobot(
            robot=name,
            axes=tuple(f"{prefix}{axis}_{unit}" for axis in limits),
            minimum=tuple(limit[f"min_{unit}"] for limit in limits.values()),
            maximum=tuple(limit[f"max_{unit}"] for limit in limits.values()),
            tip=tuple(f"{prefix}{axis}_mm" for axis in "xyz" if f"{axis}_mm" in robot["columns"]),
            unit=unit,
            rates=(
                robot[f"velocity_{unit}_s"],
                robot[f"acceleration_{unit}_s2"],
                robot[f"jerk_{unit}_s3"],
            ),
            estop=robot["stop"]["estop"],
        )
    return found
