"""The rests of an arm in a session, and what its regulators reported in them."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from contid.kinematics.model import build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid_fit.sense.calibration import CalibrationError
from contid_fit.sense.rests import rests
from contid_fit.sense.session_loads import session_calibration


@cache
def robot() -> Cosserat:
    found = load_named("stiffflop2").file.robots["arm"]
    assert isinstance(found, Cosserat)
    return found


class Recorded(list[dict[str, float]]):
    path = Path("rests.mcap")


def session(lost: set[int]) -> Any:
    """One rest of a second at 1 bar; the first regulator reports 1.02 bar except in the ticks ``lost``."""
    rows = Recorded()
    for k in range(100):
        row = {"t_s": 0.01 * k, "robot_s": 0.01 * k, "sample.arm.meas.age_s": 0.0}
        row |= {f"sample.arm.meas.{axis}_mm": float(k) for axis in "xyz"}
        for name in robot().axis_names:
            column = name.replace(".", "_")
            row[f"command.arm.{column}_bar"] = 1.0
            row[f"sample.arm.{column}.value_bar"] = 1.02
        if k in lost:
            row[f"sample.arm.{robot().axis_names[0].replace('.', '_')}.value_bar"] = math.nan
        rows.append(row)
    return rows


def test_a_lost_report_does_not_count() -> None:
    arm = robot()
    (found,) = rests(session({70}), "arm", arm, build_model(arm))
    assert found.reported == pytest.approx((1.02e5,) * len(arm.axis_names))


def test_a_measurement_that_ticks_were_skipped_behind_counts_once() -> None:
    """Its age has the time of the robots, which skipped ticks do not advance; the clock goes on."""
    arm, rows = robot(), session(set())
    for k, row in enumerate(rows):
        row["sample.arm.meas.age_s"] = 0.01 * (k % 5)
        row |= {f"sample.arm.meas.{axis}_mm": float(k // 5) for axis in "xyz"}
        row["t_s"] += 0.03 if k > 72 else 0.0
    (found,) = rests(rows, "arm", arm, build_model(arm))
    assert len(found.tips) == len({tuple(tip) for tip in found.tips.tolist()}) == 10


def test_a_regulator_that_reports_nothing_is_named_as_the_reason() -> None:
    with pytest.raises(
        CalibrationError, match=r"rests\.mcap: arm has a rest in which a regulator reports no"
    ):
        session_calibration(session(set(range(100))), "arm", robot(), 3e-4, reported=True)


def test_an_arm_that_was_disarmed_settles_anew() -> None:
    """The same command before and after it are two rests, and what is measured meanwhile belongs to none."""
    arm, rows = robot(), []
    for second in range(4):
        for row in session(set()):
            row["t_s"] += second
            row["robot_s"] += second
            if 1.0 <= row["t_s"] < 1.2:
                row |= {key: math.nan for key in row if key.startswith("command.")}
            rows.append(row)
    before, after = rests(rows, "arm", arm, build_model(arm))
    assert (before.times_s[0], before.times_s[-1]) == pytest.approx((0.5, 0.99))
    assert after.since_s == pytest.approx(1.2)
    assert (after.times_s[0], after.times_s[-1]) == pytest.approx((1.7, 3.99))
    assert (before.actuation, before.side) == (after.actuation, after.side)
