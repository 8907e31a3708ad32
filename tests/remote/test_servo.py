"""A controller in a client: set-points at its rate, under the lease, with the limits of the robot file."""

from __future__ import annotations

import asyncio
import csv
import math
import re
import subprocess
import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import pytest

from contid.client import AsyncClient, Code, RemoteError, ServoState
from tests.support.daemons import HERE, armed, arrives, command, states
from tests.support.daemons import fast_daemon as daemon
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: Of tests.support.fingers.
VELOCITY_MM_S = 100.0
TICK_S = 0.005


def circle(state: ServoState) -> Mapping[str, float] | None:
    """Half a turn in a second, from `HERE`."""
    angle = math.pi * state.time_s
    if state.time_s > 1.0:
        return None
    return {"f0.x_mm": 45.0 + 5.0 * math.cos(angle), "f0.y_mm": 75.0 + 5.0 * math.sin(angle)}


def off_circle_mm(gap_s: float) -> float:
    """How far a stream of 50 rows/s may leave the circle where no row came for up to ``gap_s``.

    As far as straight on for that time and the rest of a row, and inside by a sixth of a second difference.
    """
    acceleration_mm_s2, period_s = 5.0 * math.pi**2, 0.02
    return acceleration_mm_s2 * (gap_s * (gap_s + period_s) / 2.0 + period_s**2 / 6.0)


def test_set_points_are_followed_within_the_rates_of_the_file(tmp_path: Path) -> None:
    record = tmp_path / "servo.mcap"
    seen: list[ServoState] = []

    def controller(state: ServoState) -> Mapping[str, float] | None:
        seen.append(state)
        return circle(state)

    with daemon(2, "--record", str(record)) as running:
        with running.client() as client:
            armed(client)
            client.move({"f0.x_mm": 50.0, "f0.y_mm": 75.0})
            report = client.servo(50.0, controller)
            arrives(client, "f0", (40.0, 75.0, 0.0))
        running.end()
    assert report.refused == 0
    assert report.steps == len(seen) - 1
    assert report.steps + report.skipped == pytest.approx(50, abs=2)
    assert [state.step for state in seen] == sorted({state.step for state in seen})
    assert {*seen[0].robots} == {"f0", "f1"}
    assert seen[-1].tick > seen[0].tick
    sent_s = max(after.time_s - before.time_s for before, after in pairwise(seen))
    most_mm = off_circle_mm(sent_s + report.max_round_trip_ms / 1e3 + TICK_S)
    # What the tick recorded: the robot followed the circle, no axis faster than its limit.
    export = [*command("session", "export", str(record), "--csv", str(tmp_path / "all.csv"))]
    subprocess.run(export, check=True, capture_output=True, timeout=60)
    with (tmp_path / "all.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["target.f0.x_mm"]]
    followed = [row for row in rows if row["tick.f0.mode"] == "5"]
    assert len(followed) > 100
    for row in followed:
        x, y = float(row["target.f0.x_mm"]), float(row["target.f0.y_mm"])
        assert math.hypot(x - 45.0, y - 75.0) == pytest.approx(5.0, abs=most_mm)
    times = [float(row["t_s"]) for row in rows]
    for axis in ("left", "right"):
        lengths = [float(row[f"command.f0.{axis}_mm"]) for row in rows]
        steps = zip(pairwise(lengths), pairwise(times), strict=True)
        speeds = [abs(b - a) / (after - before) for (a, b), (before, after) in steps]
        assert 5.0 < max(speeds) <= VELOCITY_MM_S * (1.0 + 1e-6)


def test_a_refused_set_point_is_reported_and_the_next_good_one_followed() -> None:
    def controller(state: ServoState) -> Mapping[str, float] | None:
        notes.append(state.refused)
        if state.step >= 30:
            return None
        far = 10 <= state.step < 15
        return {"x_mm": 50.0 + (500.0 if far else 0.0), "y_mm": 75.0 + 0.02 * state.step}

    notes: list[str] = []
    with daemon() as running, running.client() as client:
        armed(client)
        client.move(HERE)
        report = client.servo(50.0, controller)
        assert report.refused == len([note for note in notes if note])
        assert 1 <= report.refused <= 5
        assert "out of reach" in report.messages[0]
        assert states(client) <= {"HOLD", "RUN"}


def test_an_error_of_the_controller_holds_the_robots_and_is_raised() -> None:
    def controller(state: ServoState) -> Mapping[str, float]:
        if state.step >= 5:  # a late period is skipped, here and below
            raise ZeroDivisionError("controller")
        return {"x_mm": 50.0, "y_mm": 75.0 + 2.0 * state.step}

    with daemon() as running, running.client() as client:
        armed(client)
        client.move(HERE)
        with pytest.raises(ZeroDivisionError):
            client.servo(20.0, controller)
        until(lambda: states(client) == {"HOLD"}, "the robot holds")
        client.move(HERE)


@pytest.mark.parametrize(
    ("rate_hz", "answer", "message"),
    [
        (1e4, {"x_mm": 50.0, "y_mm": 75.0}, "rate_hz=10000: allowed: above 0, up to the rate of the daemon"),
        (0.0, {"x_mm": 50.0, "y_mm": 75.0}, "rate_hz=0: allowed: above 0"),
        (50.0, {"t_s": 0.0, "x_mm": 50.0, "y_mm": 75.0}, "a set-point has no time t_s"),
        (50.0, {"x_m": 0.05, "y_mm": 75.0}, "unknown column 'x_m'"),
    ],
)
def test_what_is_wrong_is_named(rate_hz: float, answer: dict[str, float], message: str) -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        with pytest.raises(RemoteError, match=re.escape(message)):
            client.servo(rate_hz, lambda state: answer)
        assert states(client) == {"HOLD"}


def test_other_columns_than_at_first_are_refused() -> None:
    def controller(state: ServoState) -> Mapping[str, float]:
        return {"x_mm": 50.0, "y_mm": 75.0} if state.step < 3 else {"left_mm": 50.0, "right_mm": 50.0}

    with daemon() as running, running.client() as client:
        armed(client)
        with pytest.raises(RemoteError, match="returned left_mm, right_mm; at first it was x_mm, y_mm"):
            client.servo(50.0, controller)
        until(lambda: states(client) == {"HOLD"}, "the robot holds")


def test_a_stop_by_another_client_ends_the_loop_and_is_not_undone() -> None:
    with daemon() as running, running.client() as client, running.client() as operator:
        armed(client)

        def controller(state: ServoState) -> Mapping[str, float]:
            if state.step >= 10:
                operator.stop()
            return {"x_mm": 50.0, "y_mm": 75.0}

        with pytest.raises(RemoteError) as caught:
            client.servo(50.0, controller)
        assert caught.value.code in {Code.STOPPED, Code.REFUSED}
        until(lambda: states(operator) == {"OFF"}, "the robot rests")


def test_a_controller_that_hangs_loses_the_lease_and_the_robot_holds() -> None:
    with daemon() as running, running.client() as client, running.client() as other:
        armed(client)
        client.acquire(0.3)

        def controller(state: ServoState) -> Mapping[str, float]:
            if state.step >= 5:
                time.sleep(1.0)
                assert states(other) == {"HOLD"}
                assert other.status()["lease"]["holder"] is None
            return {"x_mm": 50.0, "y_mm": 75.0}

        with pytest.raises(RemoteError):
            client.servo(50.0, controller)


def test_the_asynchronous_client_takes_a_coroutine() -> None:
    async def controller(state: ServoState) -> Mapping[str, float] | None:
        await asyncio.sleep(0.001)
        return {"x_mm": 50.0, "y_mm": 75.0 + 0.1 * state.step} if state.step < 10 else None

    async def main(path: Path) -> None:
        async with AsyncClient(path) as client:
            report = await client.servo(50.0, controller)
            assert report.steps <= 10 <= report.steps + report.skipped

    with daemon() as running, running.client() as client:
        armed(client)
        asyncio.run(main(running.socket))
