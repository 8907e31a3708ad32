"""Bus health for `status` and telemetry, from the newest record (`contid.control.engine.staleness`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from contid.control.engine.staleness import Staleness, staleness_of
from contid.control.engine.tick_layout import RecordLayout, TickRecord


@dataclass(frozen=True, slots=True)
class BusHealth:
    """The data of one bus.

    Attributes:
        tier: of the oldest of its axes.
        age_s: age of that data now; infinite while nothing valid was ever read.
        silent: axes that the newest exchange did not read.
    """

    tier: Staleness
    age_s: float
    silent: tuple[str, ...]


def bus_health(
    layout: RecordLayout, record: TickRecord, axes_of: Mapping[str, Sequence[str]], now_s: float
) -> dict[str, BusHealth]:
    """The health of every bus.

    Args:
        layout: of the record.
        record: the newest one.
        axes_of: axes by bus, as ``ROBOT.AXIS``.
        now_s: the time now, on the clock of the record.
    """
    times: dict[str, float] = {}
    valid: dict[str, bool] = {}
    for robot, values in zip(layout.robots, record.robots, strict=True):
        for axis, sample in zip(robot.axes, values.axes, strict=True):
            # A value that was never read is older than anything.
            times[f"{robot.name}.{axis}"] = -math.inf if math.isnan(sample.value) else sample.time_s
            valid[f"{robot.name}.{axis}"] = sample.valid == 1.0
    period_s = 1.0 / layout.rate_hz
    health = {}
    for bus, axes in axes_of.items():
        known = [axis for axis in axes if axis in times]
        age_s = max((now_s - times[axis] for axis in known), default=math.inf)
        silent = tuple(axis for axis in known if not valid[axis])
        health[bus] = BusHealth(staleness_of(age_s, period_s), max(age_s, 0.0), silent)
    return health
