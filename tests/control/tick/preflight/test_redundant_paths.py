"""What is accepted of robots with redundant axes is followed: lines through and near straight poses."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest

from contid.control.engine.virtual import run_virtual
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.preflight.rows import Preflight
from contid.control.tick.supervisor import Mode
from contid.errors import BadInputError
from contid.robot_file.load import LoadedFile, load_named, with_mock
from contid.trajectory.read import read_trajectory
from contid.trajectory.timed import Trajectory
from tests.support.fingers import Collector

#: Distance from its target at which the solver of a model takes it as met [m].
MET_M = 1e-6
#: A tip on the axis of the straight robot, somewhat short of its reach [mm].
AXIS_MM = {"ftdcr_v4": 180.0, "tendon3": 280.0, "trirack2": 200.0, "cbha": 200.0}


def line(loaded: LoadedFile, *rows: tuple[float, ...]) -> Trajectory:
    text = "\n".join(["t_s,x_mm,y_mm,z_mm", *(",".join(map(repr, row)) for row in rows)])
    return read_trajectory(io.StringIO(text), "t.csv", loaded.driven)


def refusal(loaded: LoadedFile, trajectory: Trajectory) -> str:
    try:
        Preflight(build_robot_configs(loaded, loaded.file.rate_hz)).trajectory(trajectory, "t.csv")
    except BadInputError as error:
        return error.findings[0].message
    return ""


def run(loaded: LoadedFile, trajectory: Trajectory) -> tuple[int, float]:
    """Exit code, and how far the commanded tip was off its targets [m]."""
    seen = Collector(loaded)
    done = run_virtual(loaded, loaded.file.rate_hz, trajectory, sinks=[seen])
    off = [each.robots[0].tip_error_m for each in seen.records if each.robots[0].mode == Mode.RUN]
    return done.exit_code, max((each for each in off if math.isfinite(each)), default=0.0)


def test_a_line_on_which_answers_jump_is_refused_at_any_speed() -> None:
    """The run of this line left it by 4.93 mm at the end of which came fault 203."""
    loaded = with_mock(load_named("ftdcr_v4"))
    found = refusal(loaded, line(loaded, (0.0, -40.0, 0.0, 180.0), (12.0, 40.0, 0.0, 180.0)))
    assert "would have to jump by" in found or "rounding decides between two answers" in found
    assert "lead the path around it, or state a direction" in found


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "ftdcr_v4",
        "trirack2",
        *(pytest.param(each, marks=pytest.mark.campaign) for each in ("tendon3", "cbha")),
    ],
)
def test_lines_near_straight_poses_are_followed_or_refused(name: str) -> None:
    loaded, rng = with_mock(load_named(name)), np.random.default_rng(12)
    accepted = 0
    for k in range(6 if name == "ftdcr_v4" else 3):
        centre = np.array([0.0, 0.0, AXIS_MM[name]]) + rng.normal(0.0, (0.0, 0.3, 10.0)[k % 3], 3)
        half = rng.uniform(5.0, 30.0) * _unit(rng, k)
        ends = centre - half, centre + half
        duration = float(rng.choice([4.0, 12.0]))
        trajectory = line(loaded, (0.0, *ends[0].tolist()), (duration, *ends[1].tolist()))
        if refusal(loaded, trajectory):
            continue
        accepted += 1
        code, off_m = run(loaded, trajectory)
        assert code == 0, (name, ends, duration)
        assert off_m <= MET_M, (name, ends, duration, off_m)
    assert accepted > 0


def _unit(rng: np.random.Generator, k: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    v = rng.normal(size=3) * (1.0, 1.0, 0.0 if k % 2 else 1.0)
    return np.asarray(v / np.linalg.norm(v))
