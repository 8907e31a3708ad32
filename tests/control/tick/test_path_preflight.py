"""What is refused between rows, compared with what runs do."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.next_command import tip_tolerance_m
from contid.control.tick.preflight.path import _Follower
from contid.control.tick.preflight.rows import Preflight
from contid.control.tick.preflight.ticks import SAMPLES, Tick, run_ticks
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.robot_file.base import Quantity
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from tests.golden import make
from tests.support.fingers import Collector, load

RATE = 200.0
TIPS, AXES = "t_s,x_mm,y_mm", "t_s,left_mm,right_mm"


def trajectory_of(loaded: LoadedFile, header: str, *rows: tuple[float, ...]) -> Trajectory:
    text = "\n".join([header, *(",".join(map(repr, row)) for row in rows)])
    return read_trajectory(io.StringIO(text), "t.csv", loaded.driven)


def refused(loaded: LoadedFile, trajectory: Trajectory, rate_hz: float = RATE) -> list[tuple[int, str]]:
    try:
        Preflight(build_robot_configs(loaded, rate_hz)).trajectory(trajectory, "t.csv")
    except BadInputError as error:
        return [(found.line, found.message) for found in error.findings]
    return []


@pytest.mark.parametrize(
    ("header", "rows", "line", "message"),
    [
        # Both tips are within reach; the straight way between them passes below the reach of the finger.
        (TIPS, [(0.0, 45.0, 14.0), (20.0, -45.0, 14.0)], 3, "f0: tip ("),
        (AXES, [(0.0, 50.0, 50.0), (1.0, 90.0, 90.0), (2.0, 100.0, 98.0), (3.0, 99.0, 98.0)], 5, "100.9"),
        (AXES, [(0.0, 50.0, 50.0), (0.2, 80.0, 50.0)], 3, " mm/s, limit 100: slow down at least 1.5 times"),
        (
            AXES,
            [(0.0, 50.0, 50.0), (1.0, 99.0, 50.0), (2.0, 50.0, 50.0), (2.0001, 60.0, 50.0)],
            5,
            " mm/s2, limit 1000: ",
        ),
        (AXES, [(0.0, 50.0, 50.0), (100.0, 50.0, 50.0), (100.001, 60.0, 50.0)], 4, "f0.left needs"),
    ],
    ids=["reach", "overshoot", "speed", "jump", "after a dwell"],
)
def test_the_way_between_rows_is_refused_by_line(
    header: str, rows: list[tuple[float, ...]], line: int, message: str
) -> None:
    loaded = load(1)
    found = refused(loaded, trajectory_of(loaded, header, *rows))
    assert any(line == at and "on the way to this row" in text and message in text for at, text in found), (
        found
    )


def off_path(loaded: LoadedFile, trajectory: Trajectory) -> float:
    """How far a run takes the tip off the curve [m], and infinite where the curve leaves the limits."""
    seen = Collector(loaded)
    run_virtual(loaded, RATE, trajectory, sinks=[seen])
    worst = 0.0
    for record in seen.records:
        if record.robots[0].mode != Mode.RUN or record.source_s is None:
            continue
        curve = trajectory.targets_at(record.source_s)["f0"].actuation
        assert curve is not None
        if not all(0.0 <= value <= 0.1 for value in curve):
            return math.inf
        worst = max(worst, record.robots[0].tip_error_m)
    return worst


lengths = st.integers(45, 75).map(float)


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    steps=st.lists(st.sampled_from([0.001, 0.01, 0.05, 0.2, 0.5, 1.0]), min_size=1, max_size=6),
    points=st.lists(st.tuples(lengths, lengths), min_size=7, max_size=7),
)
def test_what_is_accepted_is_followed_and_what_is_refused_is_not(
    steps: list[float], points: list[tuple[float, float]]
) -> None:
    loaded = load(1)
    times = [0.0, *itertools.accumulate(steps)]
    rows = [(time_s, *point) for time_s, point in zip(times, points, strict=False)]
    trajectory = trajectory_of(loaded, AXES, *rows)
    off_m = off_path(loaded, trajectory)
    tolerance_m = tip_tolerance_m(Quantity.LENGTH)
    if refused(loaded, trajectory):
        assert off_m > tolerance_m * (1 - 1e-3)
    else:
        assert off_m <= tolerance_m * (1 + 1e-3)


@pytest.mark.parametrize("left_mm", [(50.0, 51.0, 66.0), (66.0, 51.0, 50.0)], ids=["end", "start"])
def test_a_speed_that_the_soft_start_or_end_takes_away_is_accepted(left_mm: tuple[float, ...]) -> None:
    """At its end the curve itself is faster than the axis, 109 mm/s of 100."""
    loaded = load(1)
    trajectory = trajectory_of(loaded, AXES, *((0.2 * k, each, 50.0) for k, each in enumerate(left_mm)))
    assert refused(loaded, trajectory) == []
    assert off_path(loaded, trajectory) <= tip_tolerance_m(Quantity.LENGTH) * (1 + 1e-3)


def no_corners(samples: Sequence[Tick]) -> set[int]:
    return set()


def test_a_trajectory_of_three_centuries_is_checked_at_once() -> None:
    loaded = load(1)
    trajectory = trajectory_of(loaded, AXES, (0.0, 50.0, 50.0), (1e10, 60.0, 50.0))
    assert refused(loaded, trajectory) == []
    assert len(list(run_ticks(trajectory, RATE, 0, 0, no_corners, SAMPLES))) < 1000


@pytest.mark.parametrize("ease", [(0, 0), (40, 20)])
def test_ticks_of_short_intervals_are_all_there(ease: tuple[int, int]) -> None:
    loaded = load(1)
    trajectory = trajectory_of(loaded, AXES, *((0.9 * k, 50.0 + k, 50.0) for k in range(11)))
    ticks = list(run_ticks(trajectory, RATE, *ease, no_corners, SAMPLES))
    assert [each.ticks for each in ticks] == [1] * len(ticks)
    assert len(ticks) == 9 * RATE + 1 + sum(ease) / 2
    for each in ticks:
        assert trajectory.time_of_row(each.row - 1) <= each.time_s <= trajectory.time_of_row(each.row)


@pytest.mark.parametrize("place", [150, 12_345_678, 19_999_850])
def test_single_ticks_next_to_a_corner_and_samples_elsewhere(place: int) -> None:
    loaded = load(1)
    trajectory = trajectory_of(loaded, AXES, (0.0, 50.0, 50.0), (1e5, 60.0, 50.0))

    def corners(samples: Sequence[Tick]) -> set[int]:
        return {k for k, each in enumerate(samples) if each.number - each.ticks < place <= each.number}

    ticks = list(run_ticks(trajectory, RATE, 0, 0, corners, SAMPLES))
    assert len(ticks) < 1000
    for before, each in itertools.pairwise(ticks):
        assert each.number - before.number == each.ticks
    assert [each.ticks for each in ticks if abs(each.number - place) < 2] == [1, 1, 1]


@pytest.mark.parametrize("row_s", [2.5, 3.5, 10.0])
def test_where_every_interval_has_a_corner_no_tick_is_left_out(row_s: float) -> None:
    loaded = load(1)
    trajectory = trajectory_of(loaded, AXES, *((row_s * k, 50.0 + k, 50.0) for k in range(4)))
    sampled = list(run_ticks(trajectory, RATE, 0, 0, no_corners, SAMPLES))
    assert max(each.ticks for each in sampled) == row_s * RATE // 200
    every = list(run_ticks(trajectory, RATE, 0, 0, lambda samples: set(range(len(samples))), SAMPLES))
    assert [each.ticks for each in every] == [1] * len(every)
    assert [each.number for each in every] == list(range(round(3 * row_s * RATE) + 1))


@pytest.mark.slow
def test_a_corner_of_the_answers_amid_a_long_interval_is_found() -> None:
    """Where a bend radius no longer binds, racks would have to gain speed faster than they can."""
    loaded = with_mock(load_named("trirack2"))
    rows = [
        (0.0, -56.4352, -37.0851, 216.593, -0.776335, -0.601411, 0.568203),
        (17.0614, -84.5198, -23.637, 196.506, -0.587557, -0.619662, 0.458977),
        (20.1899, -89.1242, 0.772879, 195.934, -0.697907, -0.630535, 0.615123),
        (26.7559, -98.5162, -24.0193, 221.162, -0.58998, -0.622668, 0.572506),
        (38.1965, -56.4352, -37.0851, 216.593, -0.435248, -0.618893, 0.48454),
    ]
    trajectory = trajectory_of(loaded, "t_s,x_mm,y_mm,z_mm,ax,ay,az", *rows)
    assert run_virtual(loaded, 100.0, trajectory).exit_code == 3
    found = refused(loaded, trajectory, 100.0)
    assert len(found) == 1
    assert found[0][0] == 6
    assert "mm/s2" in found[0][1]
    assert refused(loaded, trajectory.stretched(2.0), 100.0) == []


def test_a_corner_has_more_ticks_on_both_of_its_sides() -> None:
    """An axis that stands until the fourth of six targets and then goes at 20 mm/s: 0.1 mm per tick."""
    (config,) = build_robot_configs(load(1), RATE)
    lengths = [0.05 + 1e-4 * max(0, k - 2) for k in range(6)]
    targets = [Target(actuation=(left_m, 0.05)) for left_m in lengths]
    follower = _Follower(config, Target(actuation=(0.05, 0.05)), config.rest)
    assert follower.corners(targets, [1] * 6) == {2, 3}


@pytest.mark.parametrize(("rate_hz", "lag_s"), [(20.0, 0.05), (50.0, 0.02), (500.0, 0.02)])
def test_an_extra_axis_may_be_behind_by_its_speed_in_20_ms_or_in_a_tick(rate_hz: float, lag_s: float) -> None:
    (config,) = build_robot_configs(with_mock(load_named("cbha")), rate_hz)
    target = Target(tip_m=config.model.forward(config.rest).tip_m)
    goal = config.model.inverse(target, config.rest).actuation
    late = (*goal[:-1], goal[-1] + 0.5 * lag_s * config.velocity[-1])
    follower = _Follower(config, target, config.rest)
    assert follower._behind(late, goal, target) == pytest.approx([0.0] * (len(goal) - 1) + [0.5])


@pytest.mark.parametrize("slower", [0.7, 1.5, pytest.param(2.0, marks=pytest.mark.campaign)])
def test_what_is_accepted_on_the_axis_of_the_arm_is_followed(
    slower: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A first tip on the axis has mirrored solutions: the run takes the one that the preflight checked."""
    monkeypatch.setitem(make.CENTRES, "stiffflop2", (0.05,))
    monkeypatch.setattr(make, "TIMES_S", tuple(slower * time_s for time_s in make.TIMES_S))
    loaded = with_mock(load_named("stiffflop2"))
    trajectory = make.trajectory(loaded, make.RATE_HZ)
    accepted = not refused(loaded, trajectory, make.RATE_HZ)
    assert accepted == (slower >= 1.5)
    assert (run_virtual(loaded, make.RATE_HZ, trajectory).exit_code == 0) == accepted


def test_a_slower_path_is_checked_from_where_the_arm_stands() -> None:
    """Mid-point and tip leave one answer: the arm stands there, and snaps through on the way from rest."""
    loaded = load_named("stiffflop2")
    (config,) = build_robot_configs(loaded, RATE)
    stands = tuple(bar * 1e5 for bar in (1.393, 0.533, 0.094, 1.196, 0.602, 1.465))
    pose = config.model.forward(stands, (0.03, 0.0, -0.02))
    assert pose.mid_m is not None
    row = (*(1e3 * value for value in (*pose.tip_m, *pose.mid_m)), 0.03, 0.0, -0.02)
    header = "t_s,x_mm,y_mm,z_mm,mid.x_mm,mid.y_mm,mid.z_mm,load.fx_n,load.fy_n,load.fz_n"
    still = trajectory_of(loaded, header, (0.0, *row), (0.2, *row))
    there = Preflight([config], seeds={config.name: stands})
    there.trajectory(still, "t.csv")
    assert there.follows(still.stretched(2.0), "t.csv")
    with pytest.raises(BadInputError, match="would have to jump"):
        Preflight([config]).follows(still, "t.csv")
