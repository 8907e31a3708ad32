"""What a common run of several nodes gave, and what the others do when one does not reach its end."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from contid.remote.protocol.wire import Fields


class OnOne(enum.StrEnum):
    """What the others do when a node does not reach its end."""

    HOLD_ALL = "hold_all"
    GO_ON = "go_on"


@dataclass(frozen=True, slots=True)
class NodeStart:
    """How a node began and ended.

    Attributes:
        tick: tick in which it began; None when that is not known.
        late_s: its beginning after the common time, by the clock of this machine.
        bound_s: largest error of its clock offset.
        error: why it did not reach its end, "" if it did.
    """

    tick: int | None
    late_s: float | None
    bound_s: float
    error: str = ""


@dataclass(frozen=True, slots=True)
class FleetRunReport:
    """A common run.

    Attributes:
        experiment: its name in the recordings.
        nodes: nodes by name.
        tick_s: the longest period of a tick among them.
        duration_s: duration of the trajectory.
    """

    experiment: str
    nodes: Mapping[str, NodeStart]
    tick_s: float
    duration_s: float

    @property
    def skew_s(self) -> float | None:
        """Between the first and the last beginning; None unless all are known."""
        late = [each.late_s for each in self.nodes.values()]
        known = [each for each in late if each is not None]
        return max(known) - min(known) if len(known) == len(late) else None

    @property
    def bound_s(self) -> float:
        """Largest error of the skew: that of two nodes."""
        return sum(sorted(each.bound_s for each in self.nodes.values())[-2:])

    @property
    def complete(self) -> bool:
        """Every node reached its end."""
        return not any(each.error for each in self.nodes.values())

    def as_fields(self) -> Fields:
        """For ``--json``."""
        skew_s = self.skew_s
        return {
            "ok": self.complete,
            "experiment": self.experiment,
            "skew_ms": None if skew_s is None else round(skew_s * 1e3, 3),
            "bound_ms": round(self.bound_s * 1e3, 3),
            "tick_ms": round(self.tick_s * 1e3, 3),
            "duration_s": self.duration_s,
            "nodes": {
                name: {
                    "tick": each.tick,
                    "late_ms": None if each.late_s is None else round(each.late_s * 1e3, 3),
                    "bound_ms": round(each.bound_s * 1e3, 3),
                    "error": each.error or None,
                }
                for name, each in self.nodes.items()
            },
        }
