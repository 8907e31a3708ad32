"""``contid retime``: limits by numpy and the check of sessions, the optimum by ruckig, the path."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.session.read import Session
from contid_paths import fastest
from contid_paths.fastest import fastest_trajectory
from contid_sessions.check import check_session
from tests.support.command import contid_in

pytestmark = pytest.mark.process

pytest.importorskip("toppra", reason="the extra retime is not installed")

#: Of the shipped finger [mm/s, mm/s^2, mm/s^3], at its rate [Hz].
LIMITS, RATE_HZ = (60.0, 1000.0, 20000.0), 200.0


def table(text: str) -> NDArray[np.float64]:
    return np.array([[float(cell) for cell in row] for row in list(csv.reader(io.StringIO(text)))[1:]])


def shares(axes_mm: NDArray[np.float64]) -> list[float]:
    """Greatest velocity, acceleration and jerk from standstill to standstill, as shares of the limits."""
    still = np.concatenate([axes_mm[:1].repeat(3, axis=0), axes_mm, axes_mm[-1:].repeat(3, axis=0)])
    return [
        float(np.abs(np.diff(still, order, axis=0)).max()) * RATE_HZ**order / most
        for order, most in enumerate(LIMITS, 1)
    ]


@pytest.mark.parametrize("shape", [pytest.param("circle", marks=pytest.mark.campaign), "square"])
def test_every_limit_holds_and_the_path_stays(shape: str, tmp_path: Path) -> None:
    done = contid_in(
        tmp_path,
        "path",
        shape,
        *["--center", "20,80", "--size", "20", "--period", "3", "--for", "finger", "--fastest"],
    )
    assert done.returncode == 0, done.stderr
    (tmp_path / "fast.csv").write_text(done.stdout)
    tips = table(done.stdout)
    assert tips[-1, 0] < 4.0  # the corners of a square bind its jerk; in 3 s it exceeds it
    off = tips[:, 1:] - [20.0, 80.0]
    distance = np.linalg.norm(off, axis=1) if shape == "circle" else np.abs(off).max(axis=1)
    assert np.abs(distance - 10.0).max() < 0.1
    run = contid_in(
        tmp_path,
        *["run", "finger", "--virtual", "--trajectory", "fast.csv", "--record", "s.mcap", "--log", "log.csv"],
    )
    assert run.returncode == 0, run.stderr
    assert list(check_session(Session(tmp_path / "s.mcap"))) == []
    solved = contid_in(tmp_path, "ik", "--bare", "finger", "fast.csv")
    assert solved.returncode == 0, solved.stderr
    found = shares(table(solved.stdout)[:, 1:])
    assert max(found) <= 1.005, found
    assert max(found) > 0.9


def test_a_move_of_one_axis_is_near_the_optimum_of_ruckig(tmp_path: Path) -> None:
    import ruckig

    (tmp_path / "line.csv").write_text("t_s,left_mm,right_mm\n0,30,60\n9,60,60\n")
    done = contid_in(tmp_path, "retime", "finger", "line.csv")
    assert done.returncode == 0, done.stderr
    rows = table(done.stdout)
    assert max(shares(rows[:, 1:])) <= 1.005
    problem = ruckig.InputParameter(1)
    problem.current_position, problem.target_position = [30.0], [60.0]
    problem.max_velocity, problem.max_acceleration, problem.max_jerk = ([each] for each in LIMITS)
    best = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(problem, best)
    assert best.duration - 1.0 / RATE_HZ <= rows[-1, 0] <= 1.15 * best.duration


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t_s,x_mm,y_mm\n0,20,80\n5,20,80\n", "nothing to retime: no axis moves"),
        ("t_s,x_mm,y_mm\n0,20,80\n5,20,900\n", "out of reach"),
    ],
)
def test_what_cannot_be_retimed_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "rows.csv").write_text(text)
    done = contid_in(tmp_path, "retime", "finger", "rows.csv")
    assert (done.returncode, done.stdout, message in done.stderr) == (2, "", True), done.stderr


@pytest.mark.parametrize("early", [True, False])
def test_a_timing_of_more_rows_than_a_trajectory_may_have_is_refused(
    early: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the work, by the greatest velocity, or by the timing that was found."""
    rows = "t_s,left_mm,right_mm\n0,50,50\n1,95,50\n2,50,50\n"
    least = round(90.0 / 60.0 * RATE_HZ)  # at the greatest velocity; from rest to rest it takes longer
    monkeypatch.setattr(fastest, "MAX_ROWS", 10 if early else least + 1)
    with pytest.raises(ContidError, match=r"the fastest timing has .* rows; allowed are") as refused:
        fastest_trajectory("finger", "rows.csv", io.StringIO(rows))
    found = re.search(r"has (\S+) rows", str(refused.value))
    assert found is not None
    assert (float(found[1]) <= least + 1) is early


def test_the_units_of_axes_do_not_matter_to_the_timing() -> None:
    """Pressures in Pa were too large for the absolute tolerances of the solver: none of 1201 was found."""
    angles = np.linspace(0.0, 2.0 * np.pi, 1201)
    turns = 2.0 * np.pi / 3.0 * np.arange(3)
    chambers = 0.5 * np.maximum(0.0, np.cos(angles[:, None] + turns))
    ends_s = []
    for unit in (1.0, 1e5):
        axes, most = chambers * unit, [np.full(3, unit * most) for most in (2.0, 20.0, 400.0)]
        steps_s = np.abs(np.diff(axes, axis=0) / most[0]).max(axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps_s)])
        ends_s.append(fastest._time_optimal(along, axes, most)[1][-1])
    assert ends_s[1] == pytest.approx(ends_s[0], rel=1e-9)


@pytest.mark.campaign
def test_a_place_that_no_timing_passes_is_named(tmp_path: Path) -> None:
    """The arm has two poses for a tip there, and takes the other one."""
    done = contid_in(tmp_path, "path", "circle", "--for", "stiffflop2", "--fastest")
    assert done.returncode == 2
    assert "no timing found: near t_s = 1.3" in done.stderr
    assert "jump to another pose" in done.stderr
