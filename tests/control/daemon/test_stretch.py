"""A path that is too fast: refused with its figures, and with ``--stretch`` slowed down least."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.wiring import build_preflight
from contid.control.tick.preflight.rows import TooFastError, Unreachable
from contid.robot_file.load import load_named
from contid.session.read import Session
from contid.trajectory.read import read_trajectory
from contid_paths.stretch import ACCURACY, least_stretch
from contid_sessions.check import check_session
from tests.support.command import contid_in

pytestmark = pytest.mark.process

FINGER = load_named("finger")


def rows(times: list[float], left_mm: list[float]) -> str:
    lines = [f"{t!r},{left!r},60.0" for t, left in zip(times, left_mm, strict=True)]
    return "\n".join(["t_s,left_mm,right_mm", *lines, ""])


def sine(period_s: float) -> str:
    """One axis on a raised cosine of 30 mm: speed at most 30 pi/T, acceleration at most 60 pi^2/T^2."""
    times = np.linspace(0.0, period_s, 201)
    return rows(times.tolist(), (45.0 + 15.0 * np.cos(2.0 * math.pi * times / period_s)).tolist())


def run(text: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "rows.csv").write_text(text)
    return contid_in(folder, "run", "finger", "--virtual", "--trajectory", "rows.csv", *options)


def least_slowdown(text: str) -> float:
    trajectory = read_trajectory(io.StringIO(text), "t.csv", FINGER.driven)
    preflight = build_preflight(FINGER, 200.0, Unreachable.REFUSE)
    assert preflight is not None
    with pytest.raises(TooFastError) as refused:
        preflight.trajectory(trajectory, "t.csv")
    factor = least_stretch(trajectory, preflight, refused.value, lambda: None)
    slower = trajectory.stretched(factor)
    assert slower.end_s == pytest.approx(factor * trajectory.end_s)
    build = build_preflight(FINGER, 200.0, Unreachable.REFUSE)
    assert build is not None
    build.trajectory(slower, "t.csv")
    return factor


def test_samples_that_were_held_are_named() -> None:
    """Motion capture of 50 Hz logged at 100 Hz has each sample twice."""
    times = np.linspace(0.0, 8.0, 801)
    left_mm = 45.0 + 15.0 * np.cos(2.0 * math.pi * np.floor(times * 50.0 + 1e-6) / 50.0 / 8.0)
    preflight = build_preflight(FINGER, 200.0, Unreachable.REFUSE)
    assert preflight is not None
    held = read_trajectory(io.StringIO(rows(times.tolist(), left_mm.tolist())), "t.csv", FINGER.driven)
    with pytest.raises(TooFastError, match=r"39\d rows in motion repeat the row before"):
        preflight.trajectory(held, "t.csv")
    with pytest.raises(TooFastError) as refused:
        preflight.trajectory(read_trajectory(io.StringIO(sine(0.4)), "t.csv", FINGER.driven), "t.csv")
    assert "repeat" not in str(refused.value)


def test_the_slowdown_of_a_sine_is_that_of_its_derivatives() -> None:
    # 60 mm/s and 1000 mm/s2: speed binds for slow sines, T = 30 pi / 60.
    least = 30.0 * math.pi / 60.0
    assert least / 0.4 * 0.999 <= least_slowdown(sine(0.4)) <= least / 0.4 * ACCURACY * 1.02


def test_the_message_has_speed_limit_and_factor(tmp_path: Path) -> None:
    done = run(
        rows([0.0, 1.0, 2.0], [60.0, 60.0, 60.0]) + "3.0,95.0,60.0\n4.0,60.0,60.0\n5.0,60.0,60.0\n", tmp_path
    )
    assert done.returncode == 0, done.stderr  # 35 mm/s on average, 52.5 at most
    done = run(sine(0.4), tmp_path)
    assert done.returncode == 2
    listed = [line for line in done.stderr.splitlines() if "finger.left needs" in line]
    assert len(listed) == 5
    found = re.findall(r"needs ([\d.]+) mm/s, limit 60.*slow down at least ([\d.]+) times", done.stderr)
    for speed, factor in found:
        assert float(factor) >= float(speed) / 60.0
    last = done.stderr.splitlines()[-1]
    match = re.search(r"rows.csv:(\d+):1: (\d+) of 201 rows are too fast.*at least ([\d.]+) times, or", last)
    assert match, last
    # The greatest speed is 30 pi / 0.4 = 235.6 mm/s = 3.93 limits, a quarter or three quarters of the way.
    assert 3.9 <= float(match[3]) <= 4.1
    assert min(abs(int(match[1]) - 2 - quarter) for quarter in (50, 150)) < 8


def test_a_row_within_speed_and_acceleration_states_no_factor(tmp_path: Path) -> None:
    """Its axis could not make up for the rows before."""
    turns = [2.0 * math.pi * k / 25.0 for k in range(26)]
    circle = (
        f"{0.02 * k},{30.0 - 10.0 * (1.0 - math.cos(a))},{80.0 + 10.0 * math.sin(a)}\n"
        for k, a in enumerate(turns)
    )
    done = run("t_s,x_mm,y_mm\n" + "".join(circle), tmp_path)
    assert done.returncode == 2
    assert "falls behind at" in done.stderr
    assert "at least 1 times" not in done.stderr


def test_a_stretched_run_keeps_path_and_limits(tmp_path: Path) -> None:
    done = run(sine(0.4), tmp_path, "--stretch", "--record", "s.mcap", "--log", "log.csv", "--json")
    assert done.returncode == 0, done.stderr
    assert "too fast: stretched 3.9" in done.stderr
    assert json.loads(done.stdout)["robots"]["finger"]["tip_error_max_mm"] < 1e-9
    assert list(check_session(Session(tmp_path / "s.mcap"))) == []
    # The oracle of the limits: differences of the commands, by numpy.
    with (tmp_path / "log.csv").open() as file:
        table = list(csv.DictReader(file))
    name = next(key for key in table[0] if "left" in key)
    left_mm = np.array([float(row[name]) for row in table if row[name]])
    left_mm *= 1000.0 if left_mm.max() < 1.0 else 1.0
    assert (left_mm.min(), left_mm.max()) == (pytest.approx(30.0, abs=0.02), pytest.approx(60.0, abs=0.02))
    assert np.abs(np.diff(left_mm)).max() * 200.0 <= 60.0 * (1.0 + 1e-6)
    assert np.abs(np.diff(left_mm, 2)).max() * 200.0**2 <= 1000.0 * (1.0 + 1e-6)


def test_rows_out_of_reach_are_counted(tmp_path: Path) -> None:
    lengths = [60.0] * 11 + [100.0 + k for k in range(1, 30)]
    done = run(rows([float(k) for k in range(40)], lengths), tmp_path)
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    assert len(lines) == 6
    assert "29 of 40 rows are refused, the first on line 13" in lines[-1]


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("t_s,x_mm,y_mm\n0,20,80\n1,20,900\n", ["--stretch"], "out of reach"),
        (sine(0.4), ["--stretch", "--unreachable", "nearest"], "leave out --unreachable nearest"),
    ],
)
def test_what_cannot_be_stretched_is_refused(
    text: str, options: list[str], message: str, tmp_path: Path
) -> None:
    done = run(text, tmp_path, *options)
    assert (done.returncode, message in done.stderr) == (2, True), done.stderr
