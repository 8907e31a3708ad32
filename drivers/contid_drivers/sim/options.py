"""What a robot file may say about a simulated bus, its axes and the faults that shall happen on it."""

from __future__ import annotations

import enum
import math
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from contid.hal import DeviceKind, Rest
from contid.robot_file.base import NonNegative, Positive, Strict


class FaultKind(enum.StrEnum):
    """Everything that can go wrong on a simulated bus."""

    SILENT = "silent"  # the wire to one axis is cut: it neither hears nor answers
    STALE = "stale"  # one axis answers, with what it measured when the fault began
    OVERLOAD = "overload"  # the device drops its torque and says so, latched
    STALL = "stall"  # something holds the shaft; the overload follows by itself
    LOST = "lost"  # the whole bus is gone; the end of this fault is the plug coming back
    LATE = "late"  # replies take `delay_ms` longer


OF_AN_AXIS: Final = frozenset({FaultKind.SILENT, FaultKind.STALE, FaultKind.OVERLOAD, FaultKind.STALL})


class ScheduledFault(Strict):
    """One fault of a campaign on a simulated bus.

    Attributes:
        at_s: when it begins, after the bus was first opened.
        kind: ``silent``: one axis neither hears nor answers. ``stale``: it answers with what it measured when
            the fault began. ``overload``: it drops its torque and says so, latched. ``stall``: something
            holds its shaft. ``lost``: the whole bus is gone. ``late``: the bus answers ``delay_ms`` later.
        axis: ``ROBOT.AXIS``, for the first four kinds.
        for_s: how long it lasts; for good when left out.
        delay_ms: of the kind ``late``.
    """

    at_s: NonNegative
    kind: FaultKind
    axis: str | None = None
    for_s: Positive | None = None
    delay_ms: Positive = 20.0

    @model_validator(mode="after")
    def _axis_where_it_belongs(self) -> Self:
        if (self.axis is None) == (self.kind in OF_AN_AXIS):
            wants = "needs" if self.kind in OF_AN_AXIS else "is a fault of the whole bus and takes no"
            raise ValueError(f"kind {self.kind.value} {wants} axis")
        return self


class SimBusOptions(Strict):
    """A simulated bus.

    Attributes:
        seed: of the noise of readings; the same seed gives the same run.
        watchdog_ms: watchdog of the devices: time without a completed exchange after which they rest.
        latency_ms: how long an exchange takes.
        journal_file: receives one JSON line per event with the state of every axis.
        faults: what shall go wrong, and when.
    """

    seed: int = 0
    watchdog_ms: Annotated[float, Field(ge=10, le=10_000)] = 200.0
    latency_ms: NonNegative = 0.0
    journal_file: str | None = None
    faults: tuple[ScheduledFault, ...] = ()


#: Keys beyond ``device`` and ``on_watchdog`` that mean something for each kind of device.
KEYS_OF: Final[dict[DeviceKind, frozenset[str]]] = {
    DeviceKind.SERVO: frozenset(
        {
            "start_deg", "velocity_deg_s", "acceleration_deg_s2", "response_ms", "noise_deg",
            "current_limit_ma", "overload_s",
        }
    ),
    DeviceKind.MOTOR: frozenset(
        {
            "start_deg", "velocity_deg_s", "acceleration_deg_s2", "response_ms", "counts_per_rev",
            "current_limit_ma", "overload_s",
        }
    ),
    DeviceKind.REGULATOR: frozenset(
        {"start_bar", "slew_bar_s", "vent_bar_s", "ceiling_bar", "response_ms", "noise_bar"}
    ),
}  # fmt: skip


class SimAxisOptions(Strict):
    """A simulated device; keys left out take the defaults of its kind.

    Attributes:
        device: kind of device; some keys mean something for one kind only.
        on_watchdog: what the device does when its watchdog expires; shafts hold, regulators vent.
        start_deg: angle of a shaft before anything moved; the middle of its travel, a pose every robot has.
        start_bar: the same for a regulator; no pressure, or as near to that as its travel allows.
        velocity_deg_s: greatest speed of a shaft; 618 for a servo, 458 for a motor.
        acceleration_deg_s2: greatest acceleration of a shaft; 28600 for a servo, 4580 for a motor.
        response_ms: time constant with which the device follows; 15 for a servo, 30 for a motor, 50 for a
            regulator.
        counts_per_rev: encoder counts per turn of a motor's shaft; 4776.
        noise_deg: standard deviation of a servo's readings; 0.026.
        noise_bar: standard deviation of a regulator's readings; 0.003.
        current_limit_ma: current at which a shaft pushes hardest; 1470 for a servo, 1000 for a motor.
        overload_s: time at that current after which it drops its torque; 1 for a servo, 0.5 for a motor.
        slew_bar_s: how fast a regulator's pressure changes at most; 5.
        vent_bar_s: how fast it falls while venting; 2.
        ceiling_bar: greatest pressure of a regulator; 3.
    """

    device: DeviceKind
    on_watchdog: Rest | None = None
    start_deg: float | None = None
    start_bar: NonNegative | None = None
    velocity_deg_s: Positive | None = None
    acceleration_deg_s2: Positive | None = None
    response_ms: NonNegative | None = None
    counts_per_rev: Annotated[int, Field(ge=4)] | None = None
    noise_deg: NonNegative | None = None
    noise_bar: NonNegative | None = None
    current_limit_ma: Positive | None = None
    overload_s: Positive | None = None
    slew_bar_s: Positive | None = None
    vent_bar_s: Positive | None = None
    ceiling_bar: Positive | None = None

    @model_validator(mode="after")
    def _keys_of_this_device(self) -> Self:
        allowed = KEYS_OF[self.device]
        strange = sorted(self.model_fields_set - allowed - {"device", "on_watchdog"})
        if strange:
            raise ValueError(
                f"{', '.join(strange)} means nothing for a simulated {self.device.value}; "
                f"allowed: {', '.join(sorted(allowed))}"
            )
        if self.device is not DeviceKind.REGULATOR and self.on_watchdog is Rest.VENT:
            raise ValueError(f"a {self.device.value} cannot vent; allowed: hold, relax")
        return self

    @property
    def start(self) -> float | None:
        """Value before anything moved [rad or Pa], None to choose it from the travel."""
        if self.start_deg is not None:
            return math.radians(self.start_deg)
        return None if self.start_bar is None else self.start_bar * 1e5
