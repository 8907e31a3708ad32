"""The columns of a session in the units of robot files.

Tip positions have the columns of a trajectory (``ROBOT.x_mm``). Every row has three times: ``t_s`` since
tick 0 by the clock, ``robot_s`` by the ticks that ran (the time of the robots), and ``unix_s``, the time of
day since 1970.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from contid.control.engine.tick_layout import RecordLayout, RobotLayout
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile
from contid.session.format.channels import Field, fields
from contid.session.format.entries import Entry

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
#: Suffix of a key in SI -> suffix of a column, and the quantity.
_UNITS: Final = (
    ("_pa_s", "_bar_s", Quantity.PRESSURE),
    ("_pa", "_bar", Quantity.PRESSURE),
    ("_m", "_mm", Quantity.LENGTH),
    ("measured_age_s", "meas.age_s", None),
)
#: First columns of every table of ticks.
TIMES: Final = ("tick", "t_s", "robot_s", "unix_s")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table of ticks.

    Attributes:
        name: name of the column, with the unit.
        slot: index of the value among the flat numbers of a record.
        quantity: quantity to whose unit the value is converted, None for a value as it is recorded.
        is_integer: True when the values are integers.
    """

    name: str
    slot: int
    quantity: Quantity | None = None
    is_integer: bool = False


class RecordedTicks(Protocol):
    """What a table needs of a session; see `contid.session.read.Session`, which offers the table."""

    path: Path
    metadata: dict[str, dict[str, str]]
    layout: RecordLayout
    device_units: dict[str, str]
    rate_hz: float

    @property
    def robots(self) -> Mapping[str, RobotLayout]:
        """The robots by name."""

    def robot_file(self) -> LoadedFile:
        """The robot file of the run."""

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in their order."""


def channel_columns(session: RecordedTicks, channel: str) -> list[Column]:
    """The columns of a channel; `TIMES`, which every table has, are not among them."""
    values = fields(session.layout, session.device_units, channel)
    return [column for each in values if each.path != ("tick",) for column in _columns(each)]


def _columns(field: Field) -> Iterator[Column]:
    """The column of a number, or the three of a vector."""
    front = ".".join(field.path[1:-1] if field.path[0] == "robots" else field.path[:-1])
    front += "." if front else ""
    key = field.path[-1]
    if field.kind == "array":
        quantity = Quantity.LENGTH if key.endswith("_m") else None
        for name, slot in zip(_VECTORS[key], field.slots, strict=True):
            yield Column(front + name, slot, quantity)
        return
    if key.endswith("_rad") and len(field.path) == 3:  # an axis; values of devices stay in rad
        yield Column(front + key.removesuffix("_rad") + "_deg", field.slots[0], Quantity.ANGLE)
        return
    for end, new, unit in _UNITS:
        if field.kind == "number" and key.endswith(end):  # bits and flags may have the name of an axis
            yield Column(front + key.removesuffix(end) + new, field.slots[0], unit)
            return
    yield Column(front + key, field.slots[0], is_integer=field.kind in ("integer", "boolean"))
