"""Robot-file keys of a simulated bus, of its axes and of scheduled faults."""

from __future__ import annotations

import enum
import math
from typing import Annotated, Final, Self

from pydantic import Field, model_validator

from contid.hal import DeviceKind, Rest
from contid.robot_file.base import NonNegative, Positive, Strict
from contid.units import BAR


class FaultKind(enum.StrEnum):
    """Faults of a simulated bus; see `ScheduledFault`."""

    SILENT = "silent"
    STALE = "stale"
    OVERLOAD = "overload"
    STALL = "stall"
    LOST = "lost"
    LATE = "late"
    SCALED = "scaled"
    LEAK = "leak"
    JUMP = "jump"
    PLAY = "play"
    SWAPPED = "swapped"
    SLOW = "slow"


#: Faults of the body behind a device, which it does not report.
MECHANICAL: Final = frozenset(
    {FaultKind.SCALED, FaultKind.LEAK, FaultKind.JUMP, FaultKind.PLAY, FaultKind.SWAPPED, FaultKind.SLOW}
)
#: Keys of a kind besides ``at_s``, ``kind``, ``axis`` and ``for_s``.
_KEYS_OF_KIND: Final[dict[FaultKind, frozenset[str]]] = {
    FaultKind.LATE: frozenset({"delay_ms"}),
    FaultKind.SCALED: frozenset({"share"}),
    FaultKind.LEAK: frozenset({"share"}),
    FaultKind.SLOW: frozenset({"share"}),
    FaultKind.JUMP: frozenset({"by_deg", "by_bar"}),
    FaultKind.PLAY: frozenset({"by_deg", "by_bar"}),
    FaultKind.SWAPPED: frozenset({"other"}),
}
OF_AN_AXIS: Final = MECHANICAL | {FaultKind.SILENT, FaultKind.STALE, FaultKind.OVERLOAD, FaultKind.STALL}


class ScheduledFault(Strict):
    """One scheduled fault of a simulated bus.

    Attributes:
        at_s: begin, after the bus was first opened.
        kind: ``silent``: one axis neither receives nor answers. ``stale``: it answers with its measurement
            from the begin of the fault. ``overload``: it drops its torque and reports it, latched.
            ``stall``: its shaft is blocked, and an overload follows; a valve is stuck. ``lost``: the whole
            bus is unplugged. ``late``: the bus answers ``delay_ms`` later. ``scaled``: the axis shows
            ``share`` of its motion since then (0: a frozen encoder, 0.33: a slipped horn, -1: a wrong sign).
            ``leak``: it shows ``share`` of its pressure (0: the hose is off). ``jump``: it shows ``by_deg``
            or ``by_bar`` more. ``play``: it follows its device only by more than that (backlash, friction).
            ``swapped``: its commands go to the ``other`` axis and those of that to it. ``slow``: its top
            speed is ``share`` of what it was.
        axis: ``ROBOT.AXIS``, for faults of one axis.
        for_s: duration; without end if left out.
        delay_ms: delay of the kind ``late``.
        share: of the kinds ``scaled``, ``leak`` and ``slow``.
        by_deg, by_bar: of the kinds ``jump`` and ``play``.
        other: ``ROBOT.AXIS`` of the kind ``swapped``, on the same bus.
    """

    at_s: NonNegative
    kind: FaultKind
    axis: str | None = None
    for_s: Positive | None = None
    delay_ms: Positive = 20.0
    share: Annotated[float, Field(ge=-10, le=10)] = 0.0
    by_deg: float = 0.0
    by_bar: float = 0.0
    other: str | None = None

    @model_validator(mode="after")
    def _keys_of_this_kind(self) -> Self:
        name, own = self.kind.value, _KEYS_OF_KIND.get(self.kind, frozenset())
        of_some = frozenset().union(*_KEYS_OF_KIND.values())
        if foreign := sorted((self.model_fields_set & of_some) - own):
            allowed = f"; allowed: {', '.join(sorted(own))}" if own else ""
            raise ValueError(f"kind {name} takes no {', '.join(foreign)}{allowed}")
        if "by_deg" in own and (self.by_deg == 0.0) == (self.by_bar == 0.0):
            raise ValueError(f"kind {name} needs by_deg for a shaft, or by_bar for a regulator, other than 0")
        if self.kind is FaultKind.PLAY and not self.by > 0.0:
            raise ValueError("kind play needs a size above 0")
        return self

    @model_validator(mode="after")
    def _axis_where_it_belongs(self) -> Self:
        if (self.axis is None) == (self.kind in OF_AN_AXIS):
            rule = "needs" if self.kind in OF_AN_AXIS else "is a fault of the whole bus and takes no"
            raise ValueError(f"kind {self.kind.value} {rule} axis")
        if (self.other is None) == (self.kind is FaultKind.SWAPPED):
            rule = "needs" if self.other is None else "takes no"
            raise ValueError(f"kind {self.kind.value} {rule} other")
        if self.other is not None and self.other == self.axis:
            raise ValueError("kind swapped needs another axis as other")
        if self.kind is FaultKind.SLOW and not self.share > 0.0:
            raise ValueError("kind slow needs a share above 0")
        return self

    @property
    def by(self) -> float:
        """Size of a jump or of a play [rad or Pa]."""
        return math.radians(self.by_deg) + self.by_bar * BAR


class SimBusOptions(Strict):
    """A simulated bus.

    Attributes:
        seed: seed of the noise of readings; the same seed gives the same run.
        watchdog_ms: watchdog of the devices: without a completed exchange for this time they rest.
        latency_ms: duration of an exchange.
        journal_file: receives one JSON line per event with the state of every axis.
        faults: scheduled faults.
    """

    seed: int = 0
    watchdog_ms: Annotated[float, Field(ge=10, le=10_000)] = 200.0
    latency_ms: NonNegative = 0.0
    journal_file: str | None = None
    faults: tuple[ScheduledFault, ...] = ()


_SHAFT_KEYS: Final = frozenset(
    {"start_deg", "velocity_deg_s", "acceleration_deg_s2", "response_ms", "current_limit_ma", "overload_s"}
)
#: Keys of each kind of device besides ``device`` and ``on_watchdog``.
KEYS_OF: Final[dict[DeviceKind, frozenset[str]]] = {
    DeviceKind.SERVO: _SHAFT_KEYS | {"noise_deg"},
    DeviceKind.MOTOR: _SHAFT_KEYS | {"counts_per_rev"},
    DeviceKind.REGULATOR: frozenset(
        {"start_bar", "slew_bar_s", "vent_bar_s", "ceiling_bar", "response_ms", "noise_bar"}
    ),
}


class SimAxisOptions(Strict):
    """A simulated device; keys left out take the defaults of its kind.

    Attributes:
        device: kind of device; some keys apply to one kind only.
        on_watchdog: rest taken when the watchdog trips; by default shafts hold and regulators vent.
        start_deg: initial angle of a shaft; by default the middle of its travel.
        start_bar: initial pressure; by default the pressure of the travel nearest to 0.
        velocity_deg_s: speed limit of a shaft; 618 for a servo, 458 for a motor.
        acceleration_deg_s2: acceleration limit of a shaft; 28600 for a servo, 4580 for a motor.
        response_ms: time constant of the response; 15 for a servo, 10 for a motor, 50 for a regulator.
        counts_per_rev: encoder counts per turn of a motor's shaft; 4776.
        noise_deg: standard deviation of a servo's readings; 0.026.
        noise_bar: standard deviation of a regulator's readings; 0.003.
        current_limit_ma: current limit of a shaft; 1470 for a servo, 1000 for a motor.
        overload_s: time at that current after which it drops its torque; 1 for a servo, 0.5 for a motor.
        slew_bar_s: rate limit of a regulator's pressure; 5.
        vent_bar_s: rate at which it falls while venting; 2.
        ceiling_bar: pressure limit of a regulator; 3.
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
        foreign = sorted(self.model_fields_set - allowed - {"device", "on_watchdog"})
        if foreign:
            raise ValueError(
                f"a simulated {self.device.value} has no {', '.join(foreign)}; "
                f"allowed: {', '.join(sorted(allowed))}"
            )
        if self.device is not DeviceKind.REGULATOR and self.on_watchdog is Rest.VENT:
            raise ValueError(f"a {self.device.value} cannot vent; allowed: hold, relax")
        return self

    @property
    def start(self) -> float | None:
        """Initial value [rad or Pa], None to choose it from the travel."""
        if self.start_deg is not None:
            return math.radians(self.start_deg)
        return None if self.start_bar is None else self.start_bar * BAR
