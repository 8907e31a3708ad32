"""What the page shows of a body beside its commands: figures, against plants simulated here, and the ghost.

A body is drawn where it is measured; the commanded one is drawn beside it where that is elsewhere.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import numpy as np
import pytest

from contid.remote.server.telemetry_view import TelemetryView
from contid.robot_file.load import load_named
from contid_panel.expectation import Expectation
from contid_panel.geometry import PanelGeometry
from contid_panel.samples import actuation_of, tip_mm
from tests.support.daemons import SHIPPED

TICKS_S, FRAME = 0.01, 5


def expectation(name: str, **follow: float) -> tuple[Expectation, list[float]]:
    """The first robot of a file as the panel watches it, and its rest in the units of its axes."""
    view = TelemetryView(load_named(name), 1.0 / TICKS_S, lambda: None)
    robot, described = next(iter(view.describe()["robots"].items()))
    config = view.configs[robot]
    rest = [value * each.per_si for value, each in zip(config.rest, config.quantities, strict=True)]
    return Expectation(config, {k: {**each, **follow} for k, each in described["follow"].items()}), rest


def shown(
    name: str, command: Callable[[float], float], lag_s: float, dead_ticks: int, stuck_s: float = math.inf
) -> tuple[list[tuple[float, float]], float]:
    """What is shown of axis 0 on its way, as (time, off), and its tolerance.

    It answers with a lag and a dead time, and stands still from ``stuck_s`` on.
    """
    it, rest = expectation(name)
    at, given, out = 0.0, [0.0] * (dead_ticks + 1), []
    for tick in range(300):
        t_s = tick * TICKS_S
        if t_s < stuck_s:
            at += (given[-1 - dead_ticks] - at) * (1.0 - math.exp(-TICKS_S / lag_s))
        given.append(command(t_s))
        if tick % FRAME == 0:
            robot = {
                "state": "RUN", "command": [rest[0] + given[-1], *rest[1:]],
                "measured": [rest[0] + at, *rest[1:]], "effort": [None] * len(rest),
            }  # fmt: skip
            compared = it.compared(t_s, robot)
            assert compared is not None
            assert compared["off"][1:] == pytest.approx([0.0] * (len(rest) - 1), abs=1e-12)
            out.append((t_s, compared["off"][0]))
    return out, it.tolerances[0]


def swing(t_s: float) -> float:
    """8 mm to and fro, with up to 25 mm/s and 80 mm/s2."""
    return 8.0 * (1.0 - math.cos(math.pi * t_s)) / 2.0


@pytest.mark.parametrize("seed", range(5))
def test_a_healthy_axis_is_where_it_is_expected_all_the_way(seed: int) -> None:
    numbers = random.Random(seed)
    seen, tolerance = shown("finger", swing, numbers.uniform(0.005, 0.04), numbers.randint(0, 2))
    assert max(abs(off) for _, off in seen) < 80.0 * (FRAME * TICKS_S) ** 2 / 8 < 0.05 * tolerance


def test_an_axis_that_stands_still_is_off_by_what_is_missing() -> None:
    seen, tolerance = shown("finger", lambda t_s: 8.0 * min(t_s, 1.0), 0.02, 1, stuck_s=0.5)
    assert [off for t_s, off in seen if t_s < 0.45] == pytest.approx([0.0] * 9)
    # At rest what is shown is off the command: half of the way, and what it was behind, 0.04 s and a tick.
    assert seen[-1][1] == pytest.approx(-4.0 - 8.0 * 0.045, abs=0.05)
    assert tolerance == 1.0
    first = next(t_s for t_s, off in seen if abs(off) > tolerance)
    assert first < 0.5 + tolerance / 8.0 + 0.2  # what is missing, the dead time and the lag


@pytest.mark.parametrize("name", SHIPPED)
def test_a_robot_at_rest_is_off_by_measured_minus_commanded(name: str) -> None:
    """Also in bar, in degrees, and through the couplings and gears of the axes of trirack2."""
    it, rest = expectation(name)
    still = {"state": "HOLD", "command": rest, "measured": rest, "effort": None}
    for tick in range(20):
        compared = it.compared(tick * 0.05, still)
    assert compared is not None
    assert compared["off"] == pytest.approx([0.0] * len(rest), abs=1e-9)
    off = 0.25 * it.tolerances[-1]  # upwards: some rest where the table of their device ends
    measured = [*rest[:-1], rest[-1] + off]
    compared = it.compared(1.0, {**still, "measured": measured})
    assert compared is not None
    assert compared["off"][-1] == pytest.approx(off, rel=1e-6)


def test_nothing_is_compared_without_commands_or_measurements() -> None:
    it, rest = expectation("finger")
    good = {"state": "HOLD", "command": rest, "measured": rest, "effort": None}
    for changed in ({"state": "OFF"}, {"state": "READY"}, {"measured": None}, {"command": [None] * 2}):
        assert it.compared(0.0, good) is not None
        assert it.compared(0.05, {**good, **changed}) is None


def test_what_was_at_a_fault_stays_until_it_is_cleared() -> None:
    """A robot stops 20 ms after an axis leaves its range: no frame before may have shown it."""
    it, rest = expectation("finger")
    good = {"state": "HOLD", "command": rest, "measured": rest, "effort": None}
    off = [rest[0] - 3.0, *rest[1:]]
    it.compared(0.0, good)
    for t_s, measured in ((0.05, off), (0.1, rest), (5.0, rest)):
        compared = it.compared(t_s, {**good, "state": "FAULT", "measured": measured})
        assert compared is not None
        assert compared["at_fault"]
        assert compared["off"] == pytest.approx([-3.0, 0.0])
    assert it.compared(5.05, {**good, "state": "READY"}) is None
    assert it.compared(5.1, {**good, "state": "FAULT"}) is None  # it was not commanded


def test_a_new_motion_after_a_gap_begins_where_the_axis_is() -> None:
    it, rest = expectation("finger")
    robot = {"state": "HOLD", "command": rest, "measured": rest, "effort": None}
    it.compared(0.0, robot)
    moved = [value + 5.0 for value in rest]
    compared = it.compared(9.0, {**robot, "command": moved})
    assert compared is not None
    assert compared["off"] == [0.0, 0.0]


def test_an_axis_that_pushes_may_yield() -> None:
    """Its current is towards its command, and more than what moving takes."""
    it, rest = expectation("finger", pushing_a=0.3)
    below = [rest[0] - 5.0, *rest[1:]]
    for effort_a, pushes in ((0.5, True), (0.2, False), (-0.5, False)):
        robot = {"state": "HOLD", "command": rest, "measured": below, "effort": [effort_a, 0.0]}
        compared = it.compared(0.0, robot)
        assert compared is not None
        assert compared["pushes"] == [pushes, False]


@pytest.mark.parametrize(
    ("name", "measured", "commanded"),
    [
        ("finger", (50.0, 50.0), (60.0, 50.0)),
        ("stiffflop2", (0.0,) * 6, (0.5, 0.0, 0.0, 0.0, 0.0, 0.0)),  # a hose is off
        ("tendon3", (0.0,) * 9, (4.0, -2.0, -2.0) + (0.0,) * 6),
    ],
)
def test_a_ghost_ends_at_the_commanded_tip(
    name: str, measured: tuple[float, ...], commanded: tuple[float, ...]
) -> None:
    geometry = PanelGeometry(load_named(name), 100.0)
    (robot,) = geometry.scene.robots
    label = robot.config.name
    bodies = geometry.bodies({label: measured}, {label: commanded})
    count = robot.drawing(robot.config.rest).sections  # type: ignore[union-attr]
    for lines, values in ((bodies["robots"], measured), (bodies["ghosts"], commanded)):
        tip = tip_mm(robot, actuation_of(robot, values))
        assert tip is not None
        assert np.array(lines[label][count - 1][-1]) == pytest.approx(tip, abs=0.02)


def test_a_robot_that_follows_has_no_ghost() -> None:
    geometry = PanelGeometry(load_named("finger"), 100.0)
    (robot,) = geometry.scene.robots
    label = robot.config.name
    for commanded in ((50.0, 50.0), (50.1, 50.0), None, (None, 50.0)):
        bodies = geometry.bodies({label: (50.0, 50.0)}, {label: commanded})  # type: ignore[dict-item]
        assert bodies["ghosts"] == {}
    assert geometry.bodies({label: None}, {label: (50.0, 50.0)})["ghosts"] == {}
