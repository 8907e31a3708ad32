"""A slower move: a straight line in its columns, at no more than a share of their rates."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from contid.robot_file.load import load_named
from contid_panel.geometry import PanelGeometry
from contid_panel.rates import tip_rate_mm_s
from contid_panel.slow_move import slow_line

RATES = {"x_mm": 100.0, "y_mm": 50.0}


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5])
def test_no_column_is_faster_than_its_share(share: float) -> None:
    start, goal = {"x_mm": 10.0, "y_mm": 70.0}, {"x_mm": 40.0, "y_mm": 60.0}
    line = slow_line(start, goal, RATES, share)
    assert line.columns == ["t_s", "x_mm", "y_mm"]
    rows = np.array(line.rows)
    assert rows[0].tolist() == [0.0, 10.0, 70.0]
    assert rows[-1, 1:].tolist() == pytest.approx([40.0, 60.0])
    speeds = np.abs(np.diff(rows[:, 1:], axis=0)) / np.diff(rows[:, 0])[:, None]
    fastest = (speeds / [RATES["x_mm"], RATES["y_mm"]]).max()
    assert 0.95 * share < fastest <= share
    # On the straight line between them, with rest at both ends.
    assert np.allclose((rows[:, 1] - 10.0) / 30.0, (rows[:, 2] - 70.0) / -10.0)
    assert speeds[0].max() < 0.05 * speeds.max()


@pytest.mark.parametrize(("begin", "end"), [(170.0, -170.0), (0.0, 180.0), (-90.0, 45.0)])
def test_a_bend_turns_the_short_way_and_no_faster_than_its_share(begin: float, end: float) -> None:
    """The ends of the line between two bends are the farthest apart that two of its rows are."""
    names = ("arm.s1.bend_deg", "arm.s1.azimuth_deg")
    start, goal = (dict(zip(names, (40.0, azimuth), strict=True)) for azimuth in (begin, end))
    line = slow_line(start, goal, dict(zip(names, (20.0, 100.0), strict=True)), 0.1)
    times_s, bends, azimuths = np.array(line.rows).T
    assert (azimuths[0], azimuths[-1]) == (begin, end)
    points = bends * np.exp(1j * np.radians(azimuths))
    steps = np.abs(np.diff(points))
    assert steps.sum() == pytest.approx(abs(points[-1] - points[0]))
    assert 0.95 * 2.0 < (steps / np.diff(times_s)).max() <= 2.0


def test_a_target_where_the_robot_is_takes_a_moment() -> None:
    line = slow_line({"x_mm": 1.0}, {"x_mm": 1.0}, RATES, 0.01)
    assert {row[1] for row in line.rows} == {1.0}
    assert line.rows[-1][0] == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["hand", "tendon3", "stiffflop2", "trirack"])
def test_every_column_of_a_robot_has_a_rate_and_its_axes_a_rest(name: str) -> None:
    loaded = load_named(name)
    drawing = PanelGeometry(loaded, 100.0).describe()
    for robot, described in drawing["robots"].items():
        bends = [each["column"] for each in described["bends"]]
        columns = [*described["tip_columns"], *bends, *described["axis_columns"]]
        assert columns
        assert {column for column in columns if described["rates"][column] > 0.0} == set(columns), robot
        assert list(described["rest"]) == described["axis_columns"]


def test_the_tip_of_a_finger_is_as_fast_as_its_racks() -> None:
    """One rack of a straight finger at 100 mm/s: its tip goes along an arc, at a speed of the same order."""
    drawing = PanelGeometry(load_named("finger"), 100.0).describe()
    (finger,) = drawing["robots"].values()
    axes = [finger["rates"][each] for each in finger["axis_columns"]]
    assert 0.5 * max(axes) < finger["rates"]["x_mm"] < 20.0 * max(axes)


def test_an_axis_outside_the_domain_is_left_out_of_its_own_sample_only() -> None:
    """Two axes, of which one moves the tip at 100 and the other at 10 mm/s, in turn from sample to sample."""

    def forward(actuation: tuple[float, float]) -> SimpleNamespace:
        x, y = actuation
        if 0.0 < x < 0.5:
            raise ValueError("outside")
        turns = int(x + 0.5) % 2 == 1
        return SimpleNamespace(tip_m=(0.01 * x + 0.1 * y if turns else 0.1 * x + 0.01 * y, 0.0, 0.0))

    config = SimpleNamespace(velocity=(1.0, 1.0), model=SimpleNamespace(forward=forward, lower=(0.0, 0.0)))
    samples = [(float(number), 0.0) for number in range(4)]
    speed = tip_rate_mm_s(SimpleNamespace(config=config), samples)  # type: ignore[arg-type]
    assert speed == pytest.approx(100.0)
