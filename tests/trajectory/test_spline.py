"""Between rows: what the curve promises."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from contid.errors import BadInputError
from contid.robot_file.load import load_robot_file
from contid.robot_file.robot import RobotDescription
from contid.trajectory.read import read_trajectory
from contid.trajectory.spline import TENSION, cubic, linear
from contid.trajectory.timed import Interpolation, Trajectory


def evaluate(times: np.ndarray, coefficients: np.ndarray, t: float, derivative: int = 0) -> np.ndarray:
    index = min(int(np.searchsorted(times, t, side="right")) - 1, len(coefficients) - 1)
    c, u = coefficients[index], t - times[index]
    if derivative:
        return np.asarray(c[1] + 2 * c[2] * u + 3 * c[3] * u**2)
    return np.asarray(c[0] + c[1] * u + c[2] * u**2 + c[3] * u**3)


@pytest.fixture
def times() -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).uniform(0.6, 1.0, 40))


def test_parabolas_are_met_exactly_at_uneven_spacing(times: np.ndarray) -> None:
    def parabola(t: float | np.ndarray) -> np.ndarray:
        return np.stack([3 - 2 * t + 0.7 * t**2, 5 * t - t**2], axis=-1)

    coefficients = cubic(times, parabola(times))
    for t in np.linspace(times[0], times[-1], 501):
        assert evaluate(times, coefficients, t) == pytest.approx(parabola(t), abs=1e-10)


def test_the_curve_is_smooth_and_passes_through_every_row(times: np.ndarray) -> None:
    rows = np.random.default_rng(2).normal(size=(len(times), 3))
    coefficients = cubic(times, rows)
    steps = np.diff(times)[:, None]
    c0, c1, c2, c3 = np.moveaxis(coefficients, 1, 0)
    assert np.allclose(c0, rows[:-1], atol=0)
    assert np.allclose(c0 + c1 * steps + c2 * steps**2 + c3 * steps**3, rows[1:], atol=1e-12)
    slope_at_end = c1 + 2 * c2 * steps + 3 * c3 * steps**2
    assert np.allclose(slope_at_end[:-1], c1[1:], atol=1e-9)


def test_the_error_falls_with_the_third_power_of_the_spacing() -> None:
    errors = []
    for count in (33, 65, 129):
        times = np.linspace(0.0, 4.0, count)
        angle = math.tau * times / 4.0
        coefficients = cubic(times, np.stack([20 * np.cos(angle), 20 * np.sin(angle)], axis=1))
        fine = np.linspace(0.0, 4.0, 2001)
        points = np.array([evaluate(times, coefficients, t) for t in fine])
        truth = 20 * np.stack([np.cos(math.tau * fine / 4), np.sin(math.tau * fine / 4)], axis=1)
        errors.append(np.abs(points - truth).max())
    assert errors[0] / errors[1] > 7.0
    assert errors[1] / errors[2] > 7.0


def test_a_row_moves_only_its_neighbourhood(times: np.ndarray) -> None:
    rows = np.random.default_rng(3).normal(size=(len(times), 1))
    moved = rows.copy()
    moved[20] += 1.0
    changed = np.any(cubic(times, rows) != cubic(times, moved), axis=(1, 2))
    assert set(np.flatnonzero(changed)) == {18, 19, 20, 21}


def test_a_dwell_stays_a_dwell() -> None:
    times = np.arange(6.0)
    rows = np.array([[0.0, 0.0], [1.0, 2.0], [3.0, 3.0], [3.0, 3.0], [3.0, 4.0], [0.0, 0.0]])
    coefficients = cubic(times, rows)
    for t in np.linspace(2.0, 3.0, 21):
        assert evaluate(times, coefficients, t) == pytest.approx(rows[2], abs=0)
    # One column alone standing still (from row 3 to row 4) is not a dwell.
    assert np.any(coefficients[3, 1:, 0] != 0.0)


@settings(max_examples=120, deadline=None)
@given(
    steps=st.lists(st.floats(-4.0, 2.0).map(lambda power: 10.0**power), min_size=2, max_size=12),
    seed=st.integers(0, 2**32 - 1),
)
def test_the_curve_stays_near_its_rows_at_any_spacing(steps: list[float], seed: int) -> None:
    """Dense samples of the polynomials; the bound is TENSION / 4 of the greatest neighbouring distance."""
    times = np.concatenate([[0.0], np.cumsum(steps)])
    rows = np.random.default_rng(seed).normal(size=(len(times), 2)) * 10.0
    coefficients = cubic(times, rows)
    jumps = np.pad(np.abs(np.diff(rows, axis=0)), ((1, 1), (0, 0)))
    u = np.linspace(0.0, 1.0, 101)[:, None]
    for i, step in enumerate(np.diff(times)):
        c0, c1, c2, c3 = coefficients[i]
        points = c0 + c1 * (u * step) + c2 * (u * step) ** 2 + c3 * (u * step) ** 3
        margin = TENSION / 4.0 * jumps[i : i + 3].max(axis=0) + 1e-9
        assert np.all(points >= np.minimum(rows[i], rows[i + 1]) - margin)
        assert np.all(points <= np.maximum(rows[i], rows[i + 1]) + margin)


def test_a_circle_with_pairs_of_rows_close_in_time_stays_a_circle() -> None:
    """Rows of a 10 mm circle in pairs 0.1 ms apart; without the bound the curve leaves it by 5 mm."""
    angles = np.linspace(0.0, math.tau, 41)
    times = np.cumsum(np.where(np.arange(41) % 2, 1e-4, 0.1))
    rows = 10.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    coefficients = cubic(times, rows)
    fine = np.linspace(times[0], times[-1], 5001)
    radius = np.linalg.norm([evaluate(times, coefficients, t) for t in fine], axis=1)
    assert np.all(np.abs(radius - 10.0) < 1.6)


def test_smooth_rows_of_uneven_spacing_are_not_bounded() -> None:
    """With intervals that differ by less than 2 the curve is Bessel's, as scipy's spline with its slopes."""
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(0.05, 0.09, 60))
    rows = np.stack([np.sin(times), np.cos(2.0 * times)], axis=1)
    h, d = np.diff(times)[:, None], np.diff(rows, axis=0) / np.diff(times)[:, None]
    slopes = (h[1:] * d[:-1] + h[:-1] * d[1:]) / (h[1:] + h[:-1])
    slopes = np.vstack([2.0 * d[0] - slopes[0], slopes, 2.0 * d[-1] - slopes[-1]])
    expected = CubicHermiteSpline(times, rows, slopes)
    coefficients = cubic(times, rows)
    for t in np.linspace(times[0], times[-1], 501):
        assert evaluate(times, coefficients, t) == pytest.approx(expected(t), abs=1e-12)


def test_two_rows_are_a_line() -> None:
    times, rows = np.array([0.0, 2.0]), np.array([[1.0], [5.0]])
    assert np.array_equal(cubic(times, rows), linear(times, rows))


@pytest.fixture
def arm(configs: Path) -> dict[str, RobotDescription]:
    return dict(load_robot_file(configs / "stiffflop2.yaml").file.robots)


def read(text: str, robots: dict[str, RobotDescription], how: Interpolation) -> Trajectory:
    return read_trajectory(io.StringIO(text), "t.csv", robots, how)


@pytest.mark.parametrize("how", list(Interpolation))
def test_rows_are_hit_exactly_at_their_times_and_directions_stay_units(
    arm: dict[str, RobotDescription], how: Interpolation
) -> None:
    rate = 200
    lines = ["t_s,x_mm,y_mm,z_mm,ax,ay,az"]
    for tick in range(50):
        angle = tick / 7
        lines.append(f"{tick / rate!r},{math.cos(angle)!r},{tick},110,{math.cos(angle)},{math.sin(angle)},2")
    trajectory = read("\n".join(lines), arm, how)
    for tick in range(50):
        exact = trajectory.targets_at(tick / rate)["arm"]
        assert exact == trajectory.targets_of_row(tick)["arm"]
        between = trajectory.targets_at((tick + 0.37) / rate)["arm"].direction
        assert between is not None
        assert math.hypot(*between) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("size", ["1e-200", "5e-324"])
def test_directions_whose_squares_vanish_are_directions(arm: dict[str, RobotDescription], size: str) -> None:
    rows = f"t_s,x_mm,y_mm,z_mm,ax,ay,az\n0,0,0,110,0,-{size},{size}\n1,0,0,110,0,-2,2\n"
    found = read(rows, arm, Interpolation.CUBIC).targets_at(0.0)["arm"].direction
    assert found == pytest.approx((0.0, -math.sqrt(0.5), math.sqrt(0.5)))


def test_pressures_mid_points_and_loads_become_si(arm: dict[str, RobotDescription]) -> None:
    pressures = ",".join(f"s{s}.p{p}_bar" for s in (1, 2) for p in (1, 2, 3))
    text = f"t_s,{pressures},load.fx_n,load.fy_n,load.fz_n\n0,0.1,0.2,0.3,0.4,0.5,1.5,0,0,0.1\n"
    target = read(text, arm, Interpolation.CUBIC).targets_at(0.0)["arm"]
    assert target.actuation == pytest.approx((1e4, 2e4, 3e4, 4e4, 5e4, 1.5e5), rel=1e-15)
    assert target.load_n == (0.0, 0.0, 0.1)
    text = "t_s,x_mm,y_mm,z_mm,mid.x_mm,mid.y_mm,mid.z_mm\n0,1,2,120,3,4,60\n"
    assert read(text, arm, Interpolation.CUBIC).targets_at(0.0)["arm"].mid_m == (0.003, 0.004, 0.06)


def test_loads_step_without_overshoot(arm: dict[str, RobotDescription]) -> None:
    rows = [(t, 0.0 if t < 3 else 0.1) for t in range(6)]
    text = "t_s,x_mm,y_mm,z_mm,load.fx_n,load.fy_n,load.fz_n\n"
    trajectory = read(text + "".join(f"{t},{t},0,110,0,0,{f}\n" for t, f in rows), arm, Interpolation.CUBIC)
    for t in np.linspace(0, 5, 101):
        assert 0.0 <= trajectory.targets_at(t)["arm"].load_n[2] <= 0.1


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("0,0,0,110,0,0,0\n", "zero vector"),
        ("0,0,0,110,0,0,1\n1,0,0,110,0,0.1,-1\n", "150 degrees since line 2"),
    ],
)
def test_directions_that_cannot_be_interpolated_are_refused(
    arm: dict[str, RobotDescription], rows: str, expected: str
) -> None:
    with pytest.raises(BadInputError, match=expected):
        read("t_s,x_mm,y_mm,z_mm,ax,ay,az\n" + rows, arm, Interpolation.CUBIC)
