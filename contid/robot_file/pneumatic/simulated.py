"""The ``sim`` of a pneumatic arm: payload, wall, errors of its model and tracker of the simulated arm."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from contid.robot_file.base import Interval, NonNegative, Positive, Strict
from contid.robot_file.clearance import PlaneDescription

#: An error of a parameter [%].
_Percent = Annotated[float, Field(gt=-50, lt=100)]


class SimulatedErrors(Strict):
    """By what a simulated arm differs from the model of this file.

    Attributes:
        modulus_percent: percentage by which the modulus of every section, from the base, is greater.
        moment_percent: percentage by which the pressure moments are greater.
        regulator_bar: every regulator is off by a constant error up to this, drawn from ``seed``.
        hysteresis_bar: width of the loop between the pressure of a regulator and what acts.
        seed: seed of the errors of the regulators.
    """

    modulus_percent: tuple[_Percent, ...] = ()
    moment_percent: _Percent = 0.0
    regulator_bar: NonNegative = 0.0
    hysteresis_bar: NonNegative = 0.0
    seed: int = 0


class SimulatedTracker(Strict):
    """The tracker of a simulated tip; its measurements arrive as those of a real one.

    Attributes:
        rate_hz: measurements per second.
        noise_mm: standard deviation of every component.
        latency_ms: time from the capture of a measurement to its arrival.
        seed: seed of the noise.
        hidden_s: intervals without a measurement, after the bus was first opened.
    """

    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 50.0
    noise_mm: NonNegative = 0.3
    latency_ms: Annotated[float, Field(ge=0, le=500)] = 10.0
    seed: int = 0
    hidden_s: tuple[Interval, ...] = ()


class SimulatedArm(Strict):
    """What ``--mock`` and ``driver: sim`` simulate beside the devices; real devices ignore it.

    The arm is at rest at every instant, by the literal equations of the paper, not by contid's model.

    Attributes:
        payload_g: mass that hangs on the tip.
        payload_at_s: when it is put on, after the bus was first opened.
        payload_until_s: when it is taken off; never when left out.
        wall: rigid and without friction, in the world; it stops the tip only.
        errors: how the arm differs from the model.
        tracker: that measures the tip.
    """

    payload_g: NonNegative = 0.0
    payload_at_s: NonNegative = 0.0
    payload_until_s: Positive | None = None
    wall: PlaneDescription | None = None
    errors: SimulatedErrors = SimulatedErrors()
    tracker: SimulatedTracker = SimulatedTracker()

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.payload_until_s is not None and not self.payload_until_s > self.payload_at_s:
            raise ValueError(
                f"payload_until_s {self.payload_until_s:g} is not after payload_at_s {self.payload_at_s:g}"
            )
        return self
