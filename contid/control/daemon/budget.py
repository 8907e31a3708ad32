"""What a tick of a robot file takes of its period, and the rate that it allows.

A tick has to end within `ALLOWED` of what the slowest wire leaves of a period. The rest is for the machine,
and for what `contid.control.daemon.tick_times` does not measure: drivers of real devices, and the worker
threads of several buses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from contid.robot_file.tick_rate import rounded_down

#: Share of the period, less the time on the slowest wire, that a tick may take.
ALLOWED: Final = 0.8


@dataclass(frozen=True, slots=True)
class TickCost:
    """Processor time of a tick in one kind of motion [s]: the mean of the faster half.

    Attributes:
        motion: ``hold``, ``path`` or ``stream``.
        robots_s: of the tick of each robot.
        buses_s: of the exchange of each bus with its simulated devices.
        rest_s: of everything else: source of targets, watches, records.
    """

    motion: str
    robots_s: Mapping[str, float]
    buses_s: Mapping[str, float]
    rest_s: float

    def work_s(self, own: frozenset[str]) -> float:
        """Of all that the control process does itself; ``own``: the buses that it simulates."""
        buses_s = sum(took_s for name, took_s in self.buses_s.items() if name in own)
        return sum(self.robots_s.values()) + buses_s + self.rest_s


@dataclass(frozen=True, slots=True)
class Budget:
    """What the ticks of a file cost, beside what they may.

    Attributes:
        rate_hz: of the tick.
        wires_s: time of an exchange on the wire of each bus whose driver states it.
        own: buses whose devices the control process simulates.
        costs: by motion.
    """

    rate_hz: float
    wires_s: Mapping[str, float]
    own: frozenset[str]
    costs: tuple[TickCost, ...]

    @property
    def work_s(self) -> float:
        """Time of a tick in the motion that costs most [s]."""
        return max(cost.work_s(self.own) for cost in self.costs)

    @property
    def highest_rate_hz(self) -> float:
        """Highest rate that fits, rounded down."""
        return rounded_down(1.0 / self._least_period_s)

    @property
    def _least_period_s(self) -> float:
        return self.work_s / ALLOWED + max(self.wires_s.values(), default=0.0)

    def refusal(self) -> str:
        """Why a run is refused; empty when it fits."""
        if self._least_period_s * self.rate_hz <= 1.0:
            return ""
        cost = max(self.costs, key=lambda each: each.work_s(self.own))
        dearest = max(cost.robots_s, key=lambda name: cost.robots_s[name])
        wire_s = max(self.wires_s.values(), default=0.0)
        beside, left = (
            (f" beside {1e3 * wire_s:.3g} ms on the wire", " of what the wire leaves") if wire_s else ("", "")
        )
        share, allowed = 100.0 * self.work_s * self.rate_hz, 100.0 * ALLOWED
        return (
            f"a tick takes {1e3 * self.work_s:.3g} ms of the processor{beside}, {share:.0f} % of the "
            f"{1e3 / self.rate_hz:.3g} ms at {self.rate_hz:g} Hz (robot {dearest}: "
            f"{1e3 * cost.robots_s[dearest]:.3g} ms); allowed: {allowed:.0f} %{left}; at most "
            f"{self.highest_rate_hz:g} Hz fit: lower rate_hz, or divide the robots between files"
        )
