"""Offsets between the clocks of machines, by query: the shortest of some round trips, with a bound.

    offset = node - (sent + received) / 2        |error| <= (received - sent) / 2

for CLOCK_MONOTONIC of both machines, however unequal the two ways are. The bridge answers in the thread of
the network. Rates are those of the hosts (chrony or PTP disciplines them), so an offset is measured shortly
before it is used.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from contid.remote.protocol.wire import Fields
from contid_fleet.net import FleetError
from contid_fleet.operator import FleetOperator
from contid_fleet.rights import CLOCK

#: Round trips of one measurement, and the longest wait for one of them.
ROUND_TRIPS: Final = 20
TRIP_TIMEOUT_S: Final = 1.0


@dataclass(frozen=True, slots=True)
class RoundTrip:
    """A question for the time: sent and received by the own clock, answered by that of the node [s]."""

    sent_s: float
    node_s: float
    received_s: float


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The clock of a node against that of this machine.

    Attributes:
        offset_s: offset of the node's CLOCK_MONOTONIC from the own one.
        bound_s: largest error.
    """

    offset_s: float
    bound_s: float

    def there(self, here_s: float) -> float:
        """A time of this machine, by the clock of the node."""
        return here_s + self.offset_s

    def here(self, there_s: float) -> float:
        """A time of the node, by the clock of this machine."""
        return there_s - self.offset_s


@dataclass(frozen=True, slots=True)
class NotedOffset:
    """The offset that the conductor of a run measured of a node and noted in its recording.

    Attributes:
        operator: who conducted.
        conductor: names the boot from which its clock counts.
        offset_s: offset of the node's CLOCK_MONOTONIC from that of the conductor.
        bound_s: largest error.
        noted_s: when, by the clock of this machine.
    """

    operator: str
    conductor: str
    offset_s: float
    bound_s: float
    noted_s: float

    @classmethod
    def of(cls, operator: str, note: Fields) -> NotedOffset:
        """The offset in the fields of a `note` that the daemon took, in which it and its bound are given."""
        offset_s, bound_s = float(note["offset_s"]), float(note["bound_s"])
        return cls(operator, str(note.get("conductor", "")), offset_s, bound_s, time.monotonic())


def clock_fields() -> Fields:
    """The clocks of this machine, as a bridge answers them [ns]."""
    return {"monotonic_ns": time.monotonic_ns(), "wall_ns": time.time_ns()}


def offset_of(trips: Iterable[RoundTrip]) -> ClockOffset:
    """The offset by the shortest of the round trips, of which there is one at least."""
    best = min(trips, key=lambda trip: trip.received_s - trip.sent_s)
    middle_s = 0.5 * (best.sent_s + best.received_s)
    bound_s = 0.5 * (best.received_s - best.sent_s)
    return ClockOffset(best.node_s - middle_s, bound_s)


def measure_offset(operator: FleetOperator, node: str, count: int = ROUND_TRIPS) -> ClockOffset:
    """Ask a node for its clock some times.

    Raises:
        FleetError: it does not answer, or not with its clock.
    """
    trips: list[RoundTrip] = []
    for _ in range(count):
        sent_s = time.monotonic()
        answer = operator.timed_ask(node, CLOCK, {}, TRIP_TIMEOUT_S, urgent=True)
        if answer is None:
            continue
        received_s, response = answer
        if not response.get("ok"):
            raise FleetError(f"{node}: clock: {response['error']['message']}")
        trips.append(RoundTrip(sent_s, response["result"]["monotonic_ns"] * 1e-9, received_s))
    if not trips:
        raise FleetError(f"{node}: no answer to the question for its clock")
    return offset_of(trips)
