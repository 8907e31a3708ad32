"""The zero of an axis that a person has brought to a known place: ``contid home --here``.

A dead encoder stands still at the right place as well. So the axis is turned away by hand and brought
back, as homing does (`contid.hal.homing`): it must have moved, and come back to the same place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from contid.errors import ContidError, DeviceError
from contid.hal.homing import BACKOFF_MIN_DEG, Reference

if TYPE_CHECKING:
    from contid.control.engine.wiring import WiredBus
    from contid.hal import Bus, Sample

#: Exchanges until an axis must have answered.
_EXCHANGES: Final = 20


@contextmanager
def reading(buses: Sequence[WiredBus]) -> Iterator[Callable[[], Mapping[str, Sample]]]:
    """Open buses to read their axes, without torque; the function reads all of them once.

    Raises:
        DeviceNotFoundError: a port or a device is missing, or another process has the port.
    """
    from contid_driverkit.clock import MonotonicClock

    opened: list[Bus] = []
    try:
        for each in buses:
            bus = each.driver.open_bus(each.wiring.name, each.wiring.options, each.axes, MonotonicClock())
            opened.append(bus)
            bus.open()
        yield lambda: {axis: sample for bus in opened for axis, sample in bus.exchange({}).items()}
    finally:
        for bus in opened:
            bus.close()


def value_of(axis: str, read: Callable[[], Mapping[str, Sample]]) -> float:
    """The value of an axis [rad].

    Raises:
        DeviceError: it does not answer, or has a fault.
    """
    for _ in range(_EXCHANGES):
        sample = read()[axis]
        if sample.valid and sample.value is not None and not sample.fault:
            return sample.value
    why = sample.fault or "it does not answer"
    raise DeviceError(axis, f"has no position to be read: {why}", "see `contid doctor` and `contid fault`")


def here(
    axis: str, reference: Reference, read: Callable[[], Mapping[str, Sample]], ask: Callable[[str], None]
) -> float:
    """The value of an axis at its reference [rad], looked at twice.

    Args:
        axis: ``ROBOT.AXIS``.
        reference: what the zero of the robot file makes of the place.
        read: all axes once.
        ask: shows a request, and returns when the person has done it.

    Raises:
        DeviceError: it did not move, came back to another place, or the zero of the file is another one.
    """
    first = value_of(axis, read)
    ask(f"{axis}: reads {math.degrees(first):.2f} deg. Turn it away by hand, some 10 degrees")
    away = value_of(axis, read)
    if abs(away - first) < math.radians(BACKOFF_MIN_DEG):
        moved = f"it moved by {math.degrees(away - first):.2f} deg, of {BACKOFF_MIN_DEG:g} at least"
        raise DeviceError(axis, moved, "is its torque off, its encoder plugged in? turn it farther")
    ask(f"{axis}: reads {math.degrees(away):.2f} deg. Bring it back to its place")
    again = value_of(axis, read)
    reference.require_repetition(axis, first, again)
    reference.require_former(axis, again, turns_lost=False)
    return again


def require_place(described: float | None, homing: object, axis: str, at_mm: float) -> None:
    """Refuse axes that find their zero by themselves, and lengths of axes that have none.

    Args:
        described: ``mm_per_rev`` of the axis.
        homing: of the axis, None without.
        axis: ``ROBOT.AXIS``.
        at_mm: where it stands.
    """
    if homing is not None:
        raise ContidError(f"{axis} has `homing:`, which finds its zero: leave out --here")
    if described is None and at_mm:
        raise ContidError(f"{axis} has no length: bring it to 0 and leave out --at-mm")
