"""A live stream takes at most 1.5 times what a timed path does, in every part of it, on every shipped robot.

Times of the processor are compared within a run, never with those of another machine. A tick does the same in
every look at the same motion, so of each the shortest counts: neighbours on the machine disturb some looks.
"""

from __future__ import annotations

import pytest

from benchmarks.ticks.stream_ticks import robot_times
from contid.robot_file.load import load_named

#: Greatest ratio, robot time of a look and of its parts [s], and how often it is looked at least and at most.
MOST, LOOK_S, PART_S, LEAST, LOOKS = 1.5, 2.0, 0.5, 2, 6
SHORT = ("finger", "tendon3", "trirack2")
LONG = (
    "bend1", "catheter", "cbha", "chain", "chambers3", "ftdcr_v4", "hand", "planar2", "stiffflop1",
    "stiffflop2", "trirack", "trunk",
)  # fmt: skip


def shortest(before: list[float], now: list[float]) -> list[float]:
    return [min(pair) for pair in zip(before, now, strict=True)] if before else now


@pytest.mark.realtime  # it measures time, and neighbours on the machine make a tick take up to twice as long
@pytest.mark.parametrize("name", [*SHORT, *(pytest.param(each, marks=pytest.mark.campaign) for each in LONG)])
def test_no_part_of_a_stream_costs_much_more_than_a_path(name: str) -> None:
    loaded = load_named(name)
    part = round(PART_S * loaded.file.rate_hz)
    path_s, stream_s, ratios = list[float](), list[float](), [2.0 * MOST]
    for look in range(LOOKS):
        if look >= LEAST and max(ratios) <= MOST:
            break
        path_s = shortest(path_s, robot_times(loaded, LOOK_S, "path", 60.0))
        stream_s = shortest(stream_s, robot_times(loaded, LOOK_S, "stream", 60.0))
        usual_s = sum(path_s) / len(path_s)
        parts = [stream_s[k : k + part] for k in range(0, len(stream_s) - part + 1, part)]
        ratios = [sum(each) / part / usual_s for each in parts]
    assert max(ratios) <= MOST, [round(each, 2) for each in ratios]
