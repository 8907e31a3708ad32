"""Columns, limits and rates of the robots of a running daemon, from its ``describe``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

_BEND: Final = re.compile(r"s\d+\.(bend_deg|azimuth_deg|length_mm)")


@dataclass(frozen=True, slots=True)
class DescribedRobot:
    """The columns of one robot as a trajectory names them.

    Attributes:
        robot: its name.
        axes: columns of its axes, in their order.
        minimum, maximum: limits of the axes, in their units.
        tip: columns of its tip.
        bends: columns of the bends of its sections, as in the field ``bends`` of telemetry.
        unit: unit of its model's axes: mm or bar.
        units: units of every axis; extra ones may be in degrees.
        rates: greatest velocity, acceleration and jerk of its model's axes [unit/s, unit/s^2, unit/s^3].
        axis_rates: the same of every axis.
        estop: what `estop` does with it: relax, vent or another policy.
    """

    robot: str
    axes: tuple[str, ...]
    minimum: tuple[float, ...]
    maximum: tuple[float, ...]
    tip: tuple[str, ...]
    bends: tuple[str, ...]
    unit: str
    units: tuple[str, ...]
    rates: tuple[float, float, float]
    axis_rates: tuple[tuple[float, float, float], ...]
    estop: str


def columns_of(describe: Mapping[str, Any]) -> dict[str, DescribedRobot]:
    """The columns of every robot; names in front only when there are several robots."""
    robots = describe["robots"]
    found = {}
    for name, robot in robots.items():
        prefix = f"{name}." if len(robots) > 1 else ""
        unit = robot["unit"]
        limits = robot["axes"]
        units = tuple(unit_of(limit) for limit in limits.values())
        rates = {
            each: (robot[f"velocity_{each}_s"], robot[f"acceleration_{each}_s2"], robot[f"jerk_{each}_s3"])
            for each in dict.fromkeys((unit, *units))
        }
        found[name] = DescribedRobot(
            robot=name,
            axes=tuple(f"{prefix}{axis}_{each}" for axis, each in zip(limits, units, strict=True)),
            minimum=tuple(limit[f"min_{unit_of(limit)}"] for limit in limits.values()),
            maximum=tuple(limit[f"max_{unit_of(limit)}"] for limit in limits.values()),
            tip=tuple(f"{prefix}{axis}_mm" for axis in "xyz" if f"{axis}_mm" in robot["columns"]),
            bends=tuple(f"{prefix}{each}" for each in robot["columns"] if _BEND.fullmatch(each)),
            unit=unit,
            units=units,
            rates=rates[unit],
            axis_rates=tuple(rates[each] for each in units),
            estop=robot["stop"]["estop"],
        )
    return found


def unit_of(axis: Mapping[str, Any]) -> str:
    """The unit of an axis as ``describe`` or ``status`` has it, by its key ``min_UNIT``."""
    return next(key.removeprefix("min_") for key in axis if key.startswith("min_"))
