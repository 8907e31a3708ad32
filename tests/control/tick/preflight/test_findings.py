"""What is refused before a run: which rows are listed, which is the worst, and what the messages state."""

from __future__ import annotations

import io
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.engine.wiring import build_preflight, build_robot_configs
from contid.control.tick.preflight.reasons import rounded_up, slower
from contid.control.tick.preflight.rows import MAX_LISTED, Preflight, TooFastError, Unreachable
from contid.errors import BadInputError
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from tests.support.fingers import load

RATE = 200.0
TIPS, AXES = "t_s,x_mm,y_mm", "t_s,left_mm,right_mm"


def trajectory_of(header: str, *rows: tuple[float, ...]) -> Trajectory:
    text = "\n".join([header, *(",".join(map(repr, row)) for row in rows)])
    return read_trajectory(io.StringIO(text), "t.csv", load(1).driven)


def refused(trajectory: Trajectory) -> BadInputError:
    with pytest.raises(BadInputError) as error:
        Preflight(build_robot_configs(load(1), RATE)).trajectory(trajectory, "t.csv")
    return error.value


@given(st.floats(1.0, 1e6))
def test_a_factor_is_never_rounded_down_and_has_two_digits(factor: float) -> None:
    rounded = float(rounded_up(factor))
    assert factor * (1.0 - 1e-8) <= rounded < 1.1 * factor
    digits = f"{rounded:.10e}".split("e")[0].replace(".", "").rstrip("0")
    assert len(digits) <= 2
    at_least = f" at least {rounded_up(factor)} times" if factor > 1.0 else ""
    assert slower(factor) == f"slow down{at_least}"


def tips(*y_mm: float) -> Trajectory:
    return trajectory_of(TIPS, *((float(k), 50.0, y) for k, y in enumerate(y_mm)))


def test_a_few_rows_are_listed_and_all_are_counted_with_the_worst() -> None:
    """Rows of 30 points out of reach; the one furthest out is in the middle."""
    far = [400.0 - abs(k - 12) for k in range(30)]
    findings = refused(tips(75.0, *far)).findings
    assert len(findings) == MAX_LISTED + 1
    assert [each.line for each in findings[:-1]] == [3 + k for k in range(MAX_LISTED)]
    last = findings[-1]
    assert last.line == 3 + 12
    assert last.message.startswith(
        "30 of 31 rows are refused, the first on line 3; the worst is this one, by "
    )
    (config,) = build_robot_configs(load(1), RATE)
    model = config.model
    nearest = model.inverse(config.frame.target_in_base(Target(tip_m=(0.05, 0.4, 0.0))), config.rest)
    stated = re.search(r"by ([\d.]+) mm", last.message)
    assert stated is not None
    assert float(stated[1]) == pytest.approx(1e3 * nearest.residual_m, rel=1e-2)


def test_one_refused_row_is_not_counted_again() -> None:
    (found,) = refused(tips(75.0, 400.0, 75.0)).findings
    assert found.line == 3
    assert "f0: tip (50, 400, 0) mm is out of reach by " in found.message
    assert "(limited by" in found.message


def test_positions_of_a_few_millimetres_are_taken_for_metres() -> None:
    for y_mm, hint in ((0.3, True), (1.9, True), (400.0, False)):
        rows = trajectory_of(TIPS, (0.0, 0.05, y_mm), (1.0, 0.05, y_mm))
        assert ("are these metres" in refused(rows).findings[-1].message) == hint
    axes = trajectory_of(AXES, (0.0, 0.05, 400.0), (1.0, 0.05, 400.0))
    assert "metres" not in str(refused(axes).findings)


def test_a_fast_path_states_the_slowdown_of_its_worst_part() -> None:
    corners = (0.0, 50.0), (1.0, 70.0), (1.1, 80.0), (1.3, 50.0)
    rows = trajectory_of(AXES, *((t_s, left_mm, 50.0) for t_s, left_mm in corners))
    error = refused(rows)
    assert isinstance(error, TooFastError)
    assert error.slowdown > 1.0
    messages = " ".join(each.message for each in error.findings)
    stated = map(float, re.findall(r"at least ([\d.]+) times", messages))
    assert max(stated) == float(rounded_up(error.slowdown))
    assert "rows are too fast" in error.findings[-1].message
    # Both figures of an axis are beyond their limits by no more than the slowdown that is stated.
    for found in error.findings[:-1]:
        needs = re.search(r"needs ([\d.]+) mm/s, limit ([\d.]+)", found.message)
        if needs:
            assert float(needs[1]) / float(needs[2]) <= error.slowdown * 1.01
    with pytest.raises(TooFastError):
        Preflight(build_robot_configs(load(1), RATE)).trajectory(
            rows.stretched(0.9 * error.slowdown), "t.csv"
        )


def test_a_row_out_of_reach_beside_fast_ones_is_no_matter_of_speed() -> None:
    """The straight way between the first two rows leaves the reach; the last step is far too fast."""
    rows = trajectory_of(
        TIPS, (0.0, 45.0, 14.0), (3.0, -45.0, 14.0), (3.5, -45.0, 14.0), (3.505, -30.0, 40.0)
    )
    error = refused(rows)
    assert not isinstance(error, TooFastError)
    assert "rows are refused" in error.findings[-1].message


def test_with_nearest_points_nothing_is_refused_and_rows_are_refused_by_robot() -> None:
    loaded = load(2)
    far, good = Target(tip_m=(0.05, 0.4, 0.0)), Target(tip_m=(0.05, 0.075, 0.0))
    for unreachable, wrong in ((Unreachable.REFUSE, {"f0"}), (Unreachable.NEAREST, set())):
        preflight = build_preflight(loaded, RATE, unreachable)
        if preflight is None:
            assert unreachable is Unreachable.NEAREST
            continue
        assert preflight.row({"f0": far, "f1": None}).keys() == wrong
        assert preflight.row({"f0": good, "f1": good, "other": far}) == {}
    actuation = Target(actuation=(0.05, 0.4))
    first = build_preflight(loaded, RATE, Unreachable.REFUSE)
    assert first is not None
    message = first.row({"f0": actuation})["f0"]
    assert "actuation (50, 400) mm is out of reach (limited by" in message


def test_the_check_reports_its_progress() -> None:
    seen: list[tuple[int, int]] = []
    count = 2500
    still = trajectory_of(AXES, *((0.01 * k, 50.0, 50.0) for k in range(count)))
    checked = Preflight(build_robot_configs(load(1), RATE)).trajectory(
        still, "t.csv", lambda row, total: seen.append((row, total))
    )
    assert checked.within_reach
    assert {total for _, total in seen} == {count}
    assert [row for row, _ in seen[:3]] == [0, 1000, 2000]
    later = [row for row, _ in seen[3:]]
    assert later == sorted(later)
    assert len(later) == math.ceil((0.01 * (count - 1) * RATE + 1) / 1000)
