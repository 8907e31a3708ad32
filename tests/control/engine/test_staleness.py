"""Staleness of buses: a worse tier is told at once, a better one when it has lasted, the first not at all."""

from __future__ import annotations

from typing import Any

from contid.control.engine.events import RunEvent, to_json
from contid.control.engine.staleness import StalenessMonitor
from contid.hal import Sample

RATE_HZ = 200.0


class Told:
    """Keeps the events."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def event(self, event: RunEvent) -> None:
        self.events.append(to_json(event))


def sample(time_s: float) -> Sample:
    return Sample(value=1.0, time_s=time_s, valid=True, age_s=0.0)


def test_every_change_is_an_event() -> None:
    told = Told()
    watch = StalenessMonitor({"servos": ("a", "b"), "board": ()}, RATE_HZ, told)  # type: ignore[arg-type]
    watch.look(0, {}, 0.0)
    fresh = 0.0
    for tick in range(1, 900):
        now_s = tick / RATE_HZ
        if not 100 <= tick < 400:
            fresh = now_s - 0.002
        watch.look(tick, {"a": sample(now_s), "b": sample(fresh)}, now_s)
    assert [(e["tick"], e["before"], e["tier"]) for e in told.events] == [
        (102, "fresh", "late"), (109, "late", "stale"), (139, "stale", "old"), (299, "old", "lost"),
        (499, "lost", "fresh"),
    ]  # fmt: skip
    assert all(e["event"] == "tier" and e["bus"] == "servos" for e in told.events)
    assert told.events[0]["age_s"] > 0.015


def test_a_device_at_a_bound_does_not_flood() -> None:
    told = Told()
    watch = StalenessMonitor({"servos": ("a",)}, RATE_HZ, told)  # type: ignore[arg-type]
    for tick in range(2000):
        now_s = tick / RATE_HZ
        watch.look(tick, {"a": sample(now_s - (0.020 if tick % 4 == 1 else 0.0))}, now_s)
    assert [e["tier"] for e in told.events] == ["late"]
