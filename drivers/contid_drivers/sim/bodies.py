"""Bodies behind simulated devices, and what damages them, as the extra `emulate` computes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

from contid.entry_points import required
from contid.hal import Sample, TipMeasured
from contid_drivers.sim.devices import SimDevice
from contid_drivers.sim.options import ScheduledFault

#: Group of entry points of bodies.
BODIES: Final = "contid.bodies"


class LoadedShafts(Protocol):
    """A body whose shafts yield to what pushes on it.

    Attributes:
        axes: names of its axes on the bus.
        noise_a: standard deviation of a measured current [A].
    """

    axes: list[str]
    noise_a: float

    def settle(self, free_rad: list[float], t_s: float) -> Sequence[tuple[float, float]]:
        """Angle [rad] and current [A] of every shaft, from the angles of the servos without a load."""


class TracksTip(Protocol):
    """A body whose tip a simulated tracker measures.

    Attributes:
        axes: names of its axes on the bus.
        body: follows their values, with ``follow(values, t_s)``.
    """

    axes: list[str]
    body: Any

    def next_capture_s(self, opened_s: float) -> float:
        """When the tracker of a bus opened at ``opened_s`` captures next."""

    def capture(self, actuators: list[float], now_s: float, t_s: float) -> None:
        """Measure the tip now, ``t_s`` after the bus was opened."""

    def take_arrived(self, now_s: float) -> list[TipMeasured]:
        """Measurements whose latency is over."""


class DamagesBodies(Protocol):
    """The mechanical faults that are on, by axis and kind."""

    def refuse_unit(self, fault: ScheduledFault, device: SimDevice) -> None:
        """Refuse a size in degrees for a pressure, and one in bar for an angle."""

    def switch(self, fault: ScheduledFault, on: bool, device: SimDevice, now_s: float) -> None:
        """Begin or end a fault of an axis."""

    def commands(self, commands: Mapping[str, float]) -> Mapping[str, float]:
        """Where commands arrive."""

    def seen(self, axis: str, sample: Sample) -> Sample:
        """The sample of a device as that of its axis, which may be damaged."""


def shafts(robot: str, description: Any) -> LoadedShafts:
    """The shafts of a simulated finger."""
    found: LoadedShafts = _extra("shafts", f"{robot}: its key `sim`")(robot, description)
    return found


def tracked(robot: str, description: Any) -> TracksTip:
    """The body of a simulated robot, and its tracker."""
    found: TracksTip = _extra("tracked", f"{robot}: its key `sim`")(robot, description)
    return found


def body_faults(bus: str) -> DamagesBodies:
    """No fault yet."""
    found: DamagesBodies = _extra("faults", f"{bus}: its mechanical faults")()
    return found


def _extra(name: str, what: str) -> Any:
    return required(BODIES, name, what, "emulate")
