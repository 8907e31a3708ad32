"""The ``sim`` of robots with a body: payload and tracker, and whether the body moves with its masses."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from contid.robot_file.base import Interval, NonNegative, Positive, Strict


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


class SimulatedPayload(Strict):
    """What hangs on a simulated robot, and the tracker that measures its tip.

    Attributes:
        payload_g: mass that hangs on the tip.
        payload_at_s: when it is put on, after the bus was first opened.
        payload_until_s: when it is taken off; never when left out.
        tracker: that measures the tip.
    """

    payload_g: NonNegative = 0.0
    payload_at_s: NonNegative = 0.0
    payload_until_s: Positive | None = None
    tracker: SimulatedTracker = SimulatedTracker()

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.payload_until_s is not None and not self.payload_until_s > self.payload_at_s:
            raise ValueError(
                f"payload_until_s {self.payload_until_s:g} is not after payload_at_s {self.payload_at_s:g}"
            )
        return self

    def payload_kg(self, t_s: float) -> float:
        """The mass on the tip a time after the bus was opened."""
        on = self.payload_at_s <= t_s and (self.payload_until_s is None or t_s < self.payload_until_s)
        return 1e-3 * self.payload_g if on else 0.0


class SimulatedTendons(SimulatedPayload):
    """What ``--mock`` and ``driver: sim`` simulate beside the servos of a tendon robot; real ones ignore it.

    Attributes:
        dynamics: true: the body moves with the masses and the damping of ``dynamics``.
    """

    dynamics: Literal[True]
