"""The closing report: IK residual beside measured tip error, and a warning for too fast live rows."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.support.command import contid_in

pytestmark = pytest.mark.process


def run(text: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    done = contid_in(folder, "run", "finger", "--virtual", *options, stdin=text)
    assert done.returncode == 0, done.stderr
    return done


def line(seconds: float) -> str:
    """The tip goes from one point to another in this time [s], at nearly constant speed."""
    rows = "".join(f"{seconds * k / 40!r},{20 + k / 4!r},80\n" for k in range(41))
    return f"t_s,x_mm,y_mm\n{rows}"


def report(text: str, folder: Path) -> dict[str, Any]:
    robot: dict[str, Any] = json.loads(run(text, folder, "--json").stdout)["robots"]["finger"]
    return robot


def test_the_measured_error_is_the_lag_of_the_devices(tmp_path: Path) -> None:
    fast, slow = (report(line(seconds), tmp_path) for seconds in (1.0, 4.0))
    for each in (fast, slow):
        assert each["ik_residual_max_mm"] < 1e-9
        assert each["tip_error_max_mm"] < 1e-9
    # The same delay at a quarter of the speed is a quarter of the distance.
    ratio = fast["measured_tip_error_rms_mm"] / slow["measured_tip_error_rms_mm"]
    assert 3.0 < ratio < 5.0
    # 10 mm/s and a delay of some ticks of 5 ms.
    assert 0.05 < fast["measured_tip_error_max_mm"] < 1.0


def test_a_robot_at_rest_is_where_it_was_sent(tmp_path: Path) -> None:
    still = report("t_s,x_mm,y_mm\n0,20,80\n2,20,80\n", tmp_path)
    assert still["ticks_followed"] > 100
    assert still["measured_tip_error_rms_mm"] < 0.05


def test_the_report_names_what_each_number_is(tmp_path: Path) -> None:
    done = run(line(1.0), tmp_path)
    found = re.search(r"IK residual max (\S+) mm; measured tip error max (\S+) mm, rms (\S+) mm", done.stdout)
    assert found, done.stdout
    assert float(found[1]) < 1e-9 < 0.01 < float(found[3]) < float(found[2])
    assert "commanded" not in done.stdout


@pytest.mark.parametrize(("step_mm", "outrun"), [(20.0, True), (0.01, False)])
def test_live_rows_that_outrun_the_limits_are_counted(step_mm: float, outrun: bool, tmp_path: Path) -> None:
    # One row per tick in virtual time; from rest a jump is a line within the limits, in motion it is not.
    rows = [20.0] * 200 + [20.0 + step_mm * (k // 10 % 2) for k in range(100)] + [20.0 + step_mm] * 200
    done = run("x_mm,y_mm\n" + "".join(f"{x!r},80\n" for x in rows), tmp_path)
    found = re.search(
        r"warning: finger: the live rows outran its limits \((.*) of (\d+) ticks\)", done.stdout
    )
    assert (found is not None) is outrun, done.stdout
    if found:
        assert 0 < int(re.search(r"in (\d+)", found[1])[1]) < int(found[2])  # type: ignore[index]
        assert "commanded tip error max" in done.stdout


def test_rows_that_go_on_during_the_approach_do_not_outrun_the_limits(tmp_path: Path) -> None:
    rows = "".join(f"{20.0 + 0.05 * k!r},80\n" for k in range(500))
    done = run("x_mm,y_mm\n" + rows, tmp_path)
    assert re.search(r"\d+ ticks at the acceleration limit", done.stdout)
    assert "outran" not in done.stdout


def test_one_live_row_is_reported_as_a_way_to_a_point(tmp_path: Path) -> None:
    done = run("x_mm,y_mm\n20,80\n", tmp_path)
    assert re.search(r"0 ticks followed; \d\d ticks on the way to a point, none along rows", done.stdout)
