"""Drivers whose devices prove their wiring before a loop closes on it: ``contid bringup``.

Motors with encoders, and servos, answer single open-loop pulses, bounded on the device in duty and time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from contid.hal.bus import AxisOnBus
from contid.hal.pulses import EncoderAnswer, ProvenDevice

if TYPE_CHECKING:
    from pydantic import BaseModel


class TimedCount(NamedTuple):
    """Counts since the start of a pulse, and the device's time [s] since one of them."""

    time_s: float
    counts: int


@dataclass(frozen=True, slots=True)
class PulseAnswer:
    """What one pulse caused.

    Attributes:
        axis: the axis that was driven, ``ROBOT.AXIS``.
        duty: ordered duty, -1 to 1.
        ordered_s, driven_s: duration ordered, and driven before something ended it.
        encoders: of every axis of the bus by name, and of further inputs of the device by a name of theirs.
        positions: counts of the axis's encoder since the start, 1 ms apart, the first after 1 ms.
        fault: the driver of the motor reported a fault.
        currents_a: current of the motor, 2 ms apart, the first after 1 ms; empty without a sensor.
        timed: counts of the axis's encoder while it was driven, timed by the device; empty: by ``positions``.
    """

    axis: str
    duty: float
    ordered_s: float
    driven_s: float
    encoders: Mapping[str, EncoderAnswer]
    positions: tuple[int, ...]
    fault: bool = False
    currents_a: tuple[float, ...] = ()
    timed: tuple[TimedCount, ...] = ()

    @property
    def own(self) -> EncoderAnswer:
        """The encoder of the axis itself."""
        return self.encoders[self.axis]


@dataclass(frozen=True, slots=True)
class DriveFacts:
    """What the robot file states about a motor.

    Attributes:
        counts_per_rev: counts of its encoder in one turn of the output shaft.
        brakes: between pulses its terminals are shorted; else it coasts.
        friction, no_load_deg_s, time_constant_s: duty that just moves it, speed at full duty, response.
        stall_a: stall current; 0 without a sensor.
        sealed: motor, encoder and bridge are one part, a servo.
        longest_s: longest pulse of its device.
    """

    counts_per_rev: float
    brakes: bool
    friction: float
    no_load_deg_s: float
    time_constant_s: float
    stall_a: float = 0.0
    sealed: bool = False
    longest_s: float = 0.03


class PulsedBus(Protocol):
    """An open bus whose motors are pulsed one at a time."""

    def device(self, axis: str) -> ProvenDevice:
        """The board or servo of an axis."""

    def notes(self, axis: str) -> Sequence[str]:
        """What else was found about an axis, a line each."""

    def pulse(self, axis: str, duty: float, duration_s: float) -> PulseAnswer:
        """Drive one axis open loop, and read what every encoder showed.

        Args:
            axis: ``ROBOT.AXIS``.
            duty: -0.2 to 0.2; the device refuses more.
            duration_s: at most `DriveFacts.longest_s`; the device ends the drive by itself.

        Raises:
            DeviceError: refused, or the device does not answer.
        """

    def counts(self, axis: str) -> int:
        """Count of the axis's encoder now; moves nothing."""


@runtime_checkable
class Pulses(Protocol):
    """Pulses motors: ``contid bringup``."""

    def pulsed_bus(
        self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]
    ) -> AbstractContextManager[PulsedBus]:
        """Open the bus for pulses; on exit every motor is without power."""

    def drive_facts(self, axis: BaseModel) -> DriveFacts | None:
        """What the file states about the motor of an axis; None for a regulator."""
