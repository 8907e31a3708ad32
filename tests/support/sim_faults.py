"""Faults of a simulated bus at any time, besides those that its robot file schedules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from contid.hal import Rest
from contid.robot_file.load import LoadedFile, with_mock
from contid_drivers.sim.bus import SimBus
from contid_drivers.sim.options import FaultKind, ScheduledFault


def advance(bus: SimBus) -> None:
    """Advance the devices to the clock's time, for direct access to them."""
    bus.disable((), Rest.HOLD)


def inject(
    bus: SimBus, kind: FaultKind, axis: str | None = None, for_s: float | None = None, delay_ms: float = 20.0
) -> None:
    """Begin a fault now, for ``for_s`` or until `heal`."""
    late: dict[str, Any] = {"delay_ms": delay_ms} if kind is FaultKind.LATE else {}
    fault = ScheduledFault(at_s=0.0, kind=kind, axis=axis, for_s=for_s, **late)
    bus.switches.schedule(fault, bus._clock.now())
    advance(bus)


def heal(bus: SimBus, kind: FaultKind, axis: str | None = None) -> None:
    """End a fault now; latched consequences stay until `clear_fault` or `open`."""
    advance(bus)
    bus.switches.on.pop((kind, axis or ""), None)
    if kind is FaultKind.STALL and axis is not None:
        bus.devices[axis].motion.blocked = False


def with_faults(loaded: LoadedFile, faults: Sequence[ScheduledFault]) -> LoadedFile:
    """A shipped robot on simulated buses; each of them has the scheduled faults of its axes."""
    mocked, buses = with_mock(loaded), {}
    for name, bus in mocked.buses.items():
        axes = {axis for axis, _ in bus.axes}
        mine = tuple(fault for fault in faults if fault.axis is None or fault.axis in axes)
        buses[name] = replace(bus, options=bus.options.model_copy(update={"faults": mine}))
    return replace(mocked, buses=buses)
