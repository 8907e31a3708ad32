"""Mechanical faults of simulated axes: what a damaged body does to commands, and to what is read of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from contid.errors import DeviceError
from contid.hal import DeviceKind, Sample
from contid_drivers.sim.devices import SimDevice
from contid_drivers.sim.options import FaultKind, ScheduledFault

#: Time constant of a chamber that loses its pressure [s].
LEAK_S: Final = 0.05


@dataclass(slots=True)
class Damage:
    """A fault of one axis that is on.

    Attributes:
        fault: as scheduled.
        since_s: its begin.
        begin: the value read last before it [rad or Pa].
        seen: the value that the axis shows with it.
    """

    fault: ScheduledFault
    since_s: float
    begin: float
    seen: float

    def reading(self, value: float, now_s: float) -> float:
        """What is read of an axis whose device is at a value."""
        fault = self.fault
        match fault.kind:
            case FaultKind.SCALED:
                self.seen = self.begin + fault.share * (value - self.begin)
            case FaultKind.LEAK:
                lost = (1.0 - fault.share) * -math.expm1(-(now_s - self.since_s) / LEAK_S)
                self.seen = value * (1.0 - lost)
            case FaultKind.JUMP:
                self.seen = value + fault.by
            case FaultKind.PLAY:
                self.seen = min(max(self.seen, value - fault.by), value + fault.by)
            case _:
                self.seen = value
        return self.seen


class BodyFaults:
    """The mechanical faults that are on, by axis and kind."""

    def __init__(self) -> None:
        self._on: dict[str, dict[FaultKind, Damage]] = {}

    @staticmethod
    def refuse_unit(fault: ScheduledFault, device: SimDevice) -> None:
        """Refuse a size in degrees for a pressure, and one in bar for an angle.

        Raises:
            DeviceError: it is one.
        """
        regulator = device.kind is DeviceKind.REGULATOR
        if fault.by_deg if regulator else fault.by_bar:
            own, other = ("by_bar", "by_deg") if regulator else ("by_deg", "by_bar")
            message = f"a {fault.kind.value} of a {device.kind.value} has {own}, not {other}"
            raise DeviceError(fault.axis or "", message)

    def switch(self, fault: ScheduledFault, on: bool, device: SimDevice, now_s: float) -> None:
        """Begin or end a fault of an axis."""
        assert fault.axis is not None
        mine = self._on.setdefault(fault.axis, {})
        if on:
            at = device.motion.value
            mine[fault.kind] = Damage(fault, now_s, at, at)
        else:
            mine.pop(fault.kind, None)
        if fault.kind is FaultKind.SLOW:
            device.slow(fault.share if on else 1.0)

    def commands(self, commands: Mapping[str, float]) -> Mapping[str, float]:
        """Where commands arrive: those of swapped axes at each other's device."""
        out = dict(commands)
        for axis, damages in self._on.items():
            if (swap := damages.get(FaultKind.SWAPPED)) is not None and swap.fault.other is not None:
                other = swap.fault.other
                if axis in commands and other in commands:
                    out[axis], out[other] = commands[other], commands[axis]
        return out

    def seen(self, axis: str, sample: Sample) -> Sample:
        """The sample of a device as that of its axis, which may be damaged."""
        damages = self._on.get(axis)
        if not damages or sample.value is None:
            return sample
        value = sample.value
        for damage in damages.values():
            value = damage.reading(value, sample.time_s)
        return replace(sample, value=value)
