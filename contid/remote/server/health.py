"""Bus health for `status`, from the newest record (`contid.control.engine.staleness`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from contid.control.engine.staleness import staleness_of
from contid.control.engine.tick_layout import RecordLayout, TickRecord
from contid.remote.protocol.wire import Fields
from contid.remote.server.robot_fields import milliseconds


def bus_health(
    layout: RecordLayout, record: TickRecord, axes_of: Mapping[str, Sequence[str]], now_s: float
) -> dict[str, Fields]:
    """By bus the age of the data of its oldest axis, the tier of that age, and its silent axes.

    The age is None before the first valid sample of every axis; an axis is silent that the newest exchange
    did not read.

    Args:
        layout: of the record.
        record: the newest one.
        axes_of: axes by bus, as ``ROBOT.AXIS``.
        now_s: the time now, on the clock of the record.
    """
    samples = {
        f"{robot.name}.{axis}": sample
        for robot, values in zip(layout.robots, record.robots, strict=True)
        for axis, sample in zip(robot.axes, values.axes, strict=True)
    }
    health = {}
    for bus, axes in axes_of.items():
        read = {axis: samples[axis] for axis in axes if axis in samples}
        ages = (math.inf if math.isnan(s.value) else now_s - s.time_s for s in read.values())
        age_s = max(ages, default=math.inf)
        health[bus] = {
            "tier": staleness_of(age_s, 1.0 / layout.rate_hz).value,
            "age_ms": milliseconds(max(age_s, 0.0)),
            "silent": [axis for axis, sample in read.items() if sample.valid != 1.0],
        }
    return health
