"""Staleness of buses: worse tiers are reported at once, better ones when they last, the first not."""

from __future__ import annotations

from typing import Any

from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.control.engine.staleness import StalenessMonitor
from contid.hal import Sample

RATE_HZ = 200.0


class KeptEvents:
    """Keeps the events."""

    def __init__(self) -> None:
        self.events: list[dict[str, Any]] = []

    def event(self, event: RunEvent) -> None:
        self.events.append(to_json(event))


def sample(time_s: float) -> Sample:
    return Sample(value=1.0, time_s=time_s, valid=True, age_s=0.0)


def test_every_change_is_an_event() -> None:
    kept = KeptEvents()
    watch = StalenessMonitor({"servos": ("a", "b"), "board": ()}, RATE_HZ, kept)  # type: ignore[arg-type]
    watch.classify(0, {}, 0.0)
    fresh = 0.0
    for tick in range(1, 900):
        now_s = tick / RATE_HZ
        if not 100 <= tick < 400:
            fresh = now_s - 0.002
        watch.classify(tick, {"a": sample(now_s), "b": sample(fresh)}, now_s)
    assert [(e["tick"], e["before"], e["tier"]) for e in kept.events] == [
        (102, "fresh", "late"), (109, "late", "stale"), (139, "stale", "old"), (299, "old", "lost"),
        (499, "lost", "fresh"),
    ]  # fmt: skip
    assert all(e["event"] == "tier" and e["bus"] == "servos" for e in kept.events)
    assert kept.events[0]["age_s"] > 0.015


def test_a_device_at_a_bound_does_not_flood() -> None:
    kept = KeptEvents()
    watch = StalenessMonitor({"servos": ("a",)}, RATE_HZ, kept)  # type: ignore[arg-type]
    for tick in range(2000):
        now_s = tick / RATE_HZ
        watch.classify(tick, {"a": sample(now_s - (0.020 if tick % 4 == 1 else 0.0))}, now_s)
    assert [e["tier"] for e in kept.events] == ["late"]
