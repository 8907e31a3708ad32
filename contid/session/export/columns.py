"""The columns of a session in the units of robot files.

Tip positions have the columns of a trajectory (``ROBOT.x_mm``). Every row has three times: ``t_s`` since
tick 0 by the clock, ``robot_s`` by the ticks that ran (the time of the robots), and ``unix_s``, the time of
day since 1970.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from contid.session.format.channels import Field, fields
from contid.session.read import Session
from contid.units import DEG

_VECTORS: Final = {
    "tip_m": ("x_mm", "y_mm", "z_mm"),
    "direction": ("ax", "ay", "az"),
    "x_axis": ("bx", "by", "bz"),
    "mid_m": ("mid.x_mm", "mid.y_mm", "mid.z_mm"),
    "measured_tip_m": ("meas.x_mm", "meas.y_mm", "meas.z_mm"),
    "measured_direction": ("meas.ax", "meas.ay", "meas.az"),
    "estimated_load_n": ("est.fx_n", "est.fy_n", "est.fz_n"),
    "estimated_sigma_n": ("est.sigma_x_n", "est.sigma_y_n", "est.sigma_z_n"),
    "load_n": ("load.fx_n", "load.fy_n", "load.fz_n"),
}
#: First columns of every table of ticks.
TIMES: Final = ("tick", "t_s", "robot_s", "unix_s")


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Attributes:
        name: with its unit.
        slot: place in a record.
        scale: from SI to the unit, of numbers and of arrays; None for integers.
    """

    name: str
    slot: int
    scale: Callable[[float], float] | None


def channel_columns(session: Session, channel: str) -> list[Column]:
    """The columns of a channel after `TIMES`."""
    values = fields(session.layout, session.device_units, channel)
    return [column for each in values if each.path != ("tick",) for column in _columns(each)]


def _columns(each: Field) -> Iterator[Column]:
    front = ".".join(each.path[1:-1] if each.path[0] == "robots" else each.path[:-1])
    front += "." if front else ""
    key = each.path[-1]
    if each.kind == "array":
        scale = _to_mm if key.endswith("_m") else _same
        for name, slot in zip(_VECTORS[key], each.slots, strict=True):
            yield Column(front + name, slot, scale)
        return
    if key.endswith("_rad") and len(each.path) == 3:  # an axis; values of devices stay in rad
        yield Column(front + key.removesuffix("_rad") + "_deg", each.slots[0], _to_deg)
        return
    for end, new, scale in _UNITS:
        if key.endswith(end):
            yield Column(front + key.removesuffix(end) + new, each.slots[0], scale)
            return
    whole = each.kind in ("integer", "boolean")
    yield Column(front + key, each.slots[0], None if whole else _same)


def _same(value: float) -> float:
    return value


def _to_mm(value: float) -> float:
    return value * 1e3


def _to_deg(value: float) -> float:
    return value / DEG


def _to_bar(value: float) -> float:
    return value / 1e5


#: Suffix of a key in SI -> suffix of a column, and the conversion.
_UNITS: Final = (
    ("_pa_s", "_bar_s", _to_bar),
    ("_pa", "_bar", _to_bar),
    ("_m", "_mm", _to_mm),
    ("measured_age_s", "meas.age_s", _same),
)
