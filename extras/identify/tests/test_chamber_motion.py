"""Arms of chambers in motion: fitted to the tips of a plant that small steps of Euler move."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid_identify.ahead import predicted_tips
from contid_identify.answer import CommandedTrace
from contid_identify.chambers.file import chamber_motion_of, read_motion, write_motion
from contid_identify.chambers.fit import arm_of, fit_chamber_motion
from contid_identify.chambers.judged import can_be_apart, judged_apart, judged_by_blocks
from contid_identify.chambers.motion import ChamberArm, ChamberMotion
from contid_identify.printed import motion_lines
from contid_identify.sections.arcs import chained
from contid_identify.sections.play import played
from contid_identify.stages import tip_motion

PERIOD_S = 0.05
PA = 1e5
#: Two sections with a chamber on each of two sides and one in the middle, as that of the recordings.
ARM = ChamberArm(
    np.array([0, 0, 0, 1, 1, 1]), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 0.0]] * 2),
    np.array([0.12, 0.12]), np.array([0.01, 0.0]),
)  # fmt: skip
AXES = tuple("abcdef")
PATTERNS = ("100100", "010100", "001010", "110000", "111111")


def plant(pattern: str, stuck: float = 0.0) -> CommandedTrace:
    """A second of rest, a pattern and its end; sleeves stick, sides are no longer than 0.17 m."""
    on = np.array([float(c) for c in pattern])
    sent = PA * np.concatenate([np.zeros((20, 6)), np.tile(on, (100, 1)), np.zeros((100, 6))])
    fine, first, second = 10, np.zeros(6), np.zeros(6)
    step_s, late = PERIOD_S / fine, 40
    held = np.concatenate([np.zeros((late, 6)), np.repeat(sent / PA, fine, axis=0)])
    slid, tips = np.array([stuck, stuck]), []
    for k in range(len(sent) * fine):
        if k % fine == 0:
            tips.append(plant_tip(second, slid))
        for gap, x, times in ((held[k] - first, first, (0.3, 1.5)), (first - second, second, (0.2, 0.5))):
            x += gap * step_s / np.where(gap > 0.0, *times)
        force = second.reshape(2, 3).sum(axis=1)
        slid = np.clip(slid, force - 0.6, force + 0.6)
    return CommandedTrace(PERIOD_S, sent, np.arange(float(len(sent))) * PERIOD_S, np.array(tips), pattern)


def plant_tip(x: Array, slid: Array) -> Array:
    """The tip of two arcs in a plane, as complex numbers."""
    place, heading, above = 0.0 + 0.0j, 0.0, 0.0
    for k, link_m in enumerate((0.01, 0.0)):
        right, left, middle = x[3 * k : 3 * k + 3].tolist()
        length = 0.12 + 0.012 * (0.5 * (right + left + middle) + 0.5 * slid[k])
        bend = 0.6 * (right - left) + (0.2 * above if k else 0.0)
        above += right - left
        most = max((0.17 - length) / 0.06, 0.0)
        bend = math.copysign(min(abs(bend), most), bend)
        heading += 0.5 * bend
        chord = length if abs(bend) < 1e-9 else length * math.sin(0.5 * bend) / (0.5 * bend)
        place += chord * complex(math.cos(heading), math.sin(heading))
        heading += 0.5 * bend
        place += link_m * complex(math.cos(heading), math.sin(heading))
    return np.array([place.imag, 0.0, place.real])


@cache
def model() -> ChamberMotion:
    return fit_chamber_motion("arm", AXES, ARM, [plant(each) for each in PATTERNS], "a test", kept_out=False)


@pytest.mark.slow
def test_a_pattern_that_was_not_recorded() -> None:
    trace = plant("100010", stuck=0.2)
    found = predicted_tips(model(), trace.sent, PERIOD_S, trace.at_s, trace.measured, 0.0)
    off = np.linalg.norm(found.errors_m, axis=1)
    moved = np.linalg.norm(trace.measured - trace.measured[0], axis=1)
    assert np.sqrt((off**2).mean()) < 0.1 * np.sqrt((moved**2).mean())
    assert found.outside == 0.0
    assert model().outside(2.0 * trace.sent, PERIOD_S, trace.at_s) > 0.3
    assert model().open_loop.rmse_m < 4e-3
    assert model().times_s[0] == pytest.approx(0.2, abs=0.1)


def test_a_recording_begins_at_its_first_tips() -> None:
    trace = plant("100100")
    moved = trace.measured + np.array([0.004, 0.003, -0.002])
    tips = model().zeroed(trace.sent, PERIOD_S, trace.at_s, moved).predict(trace.sent, PERIOD_S, trace.at_s)
    assert np.allclose(tips[:3], moved[:3], atol=1e-4)


def test_arcs_behind_each_other() -> None:
    # A quarter of a circle of radius 1 towards y, then a straight metre along y.
    end = chained(np.array([[[0.0, 0.5 * np.pi], [0.0, 0.0]]]), np.array([[0.5 * np.pi, 1.0]]), np.zeros(2))
    assert np.allclose(end, [[0.0, 2.0, 1.0]])
    # The second one bends on to x: out of the plane of the first one.
    end = chained(
        np.array([[[0.0, 0.5 * np.pi], [0.5 * np.pi, 0.0]]]), np.full((1, 2), 0.5 * np.pi), np.zeros(2)
    )
    assert np.allclose(end, [[1.0, 2.0, 1.0]])


@pytest.mark.slow
def test_errors_are_those_of_recordings_that_were_left_out() -> None:
    """Each of seven recordings is predicted by a fit that has not seen it; here one that errs by a place."""
    traces = [plant(each) for each in (*PATTERNS, "000001", "100010")]
    asked: list[list[str]] = []

    def fitted_to(others: Sequence[CommandedTrace]) -> ChamberMotion:
        asked.append([each.name for each in others])
        return replace(model(), times_s=model().times_s + np.array([0.1, 0.0, 0.0, 0.0, 0.0]))

    assert can_be_apart(traces)
    found = judged_apart(model(), traces, fitted_to)
    assert len(asked) == 5  # fits at most
    names = [each.name for each in traces]
    assert [name for each in asked for name in names if name not in each] == names
    assert found.apart == len(traces)
    late = [
        predicted_tips(fitted_to([]), each.sent, PERIOD_S, each.at_s, each.measured, 0.0).errors_m
        for each in traces
    ]
    rmse_m = float(np.sqrt((np.concatenate(late) ** 2).sum(axis=1).mean()))
    assert found.open_loop.rmse_m == pytest.approx(rmse_m, rel=1e-6)
    assert "each of the 7 recordings predicted by a fit to others" in "\n".join(motion_lines(found))
    assert np.array_equal(found.numbers, model().numbers)


def test_recordings_without_others_that_move_are_judged_by_blocks() -> None:
    moved, still = plant("100100"), replace(plant("100100"), sent=np.zeros((220, 6)))
    assert not can_be_apart([moved])
    assert not can_be_apart([moved, still])
    assert can_be_apart([moved, plant("010100")])
    assert "that day" in "\n".join(motion_lines(judged_by_blocks(model(), [moved], kept_out=True)))


@pytest.mark.campaign
def test_errors_between_patterns_are_larger_than_those_within() -> None:
    """Three patterns, each predicted by the two others, and a fourth one, which the errors hold for."""
    traces = [plant(each) for each in ("100100", "110000", "001010")]
    found = fit_chamber_motion("arm", AXES, ARM, traces, "a test")
    assert found.apart == len(traces)
    within = judged_by_blocks(found, traces, kept_out=True)
    assert found.open_loop.rmse_m > within.open_loop.rmse_m
    new = plant("010010")
    tips = predicted_tips(found, new.sent, PERIOD_S, new.at_s, new.measured, 0.0)
    assert np.sqrt((tips.errors_m**2).sum(axis=1).mean()) < 1.5 * found.open_loop.rmse_m


def test_a_play_stays_behind() -> None:
    assert played(np.array([0.0, 1.0, 0.5, -1.0]), 0.4, 0.0).tolist() == pytest.approx([0.0, 0.6, 0.6, -0.6])


def test_the_file_holds_every_number(tmp_path: Path) -> None:
    file, sent = tmp_path / "m.json", plant("100100").sent
    write_motion(model(), file)
    again = read_motion(file)
    assert isinstance(again, ChamberMotion)
    assert np.array_equal(again.predict(sent, PERIOD_S), model().predict(sent, PERIOD_S))
    assert again.errors == model().errors
    assert any("section 2" in line for line in motion_lines(again))
    for old, new, message in (
        ('"times_s": [', '"times_s": [1.0, ', "times_s"),
        ('"play_m"', '"plays_m"', "play_m"),
        ('"span_pa": ', '"span_pa": -', "above 0"),
    ):
        (tmp_path / "bad.json").write_text(file.read_text().replace(old, new))
        with pytest.raises(ContidError, match=message):
            read_motion(tmp_path / "bad.json")
    with pytest.raises(ContidError, match="identify it anew"):
        chamber_motion_of({}, file)


def test_what_it_has_not_is_refused() -> None:
    sent = plant("100100").sent
    with pytest.raises(ContidError, match="needed"):
        model().predict(sent[:, :3], PERIOD_S)
    with pytest.raises(ContidError, match="finite"):
        model().predict(sent * np.nan, PERIOD_S)
    with pytest.raises(ContidError, match="payloads"):
        model().predict(sent, PERIOD_S, load_kg=0.1)
    still = replace(plant("100100"), sent=np.zeros((len(sent), 6)))
    with pytest.raises(ContidError, match="inflated"):
        fit_chamber_motion("arm", AXES, ARM, [still], "")


def test_chambers_of_a_robot_file() -> None:
    robot = load_named("stiffflop2").driven["arm"]
    assert isinstance(robot, Cosserat)
    arm = arm_of(robot)
    assert arm.section.tolist() == [0, 0, 0, 1, 1, 1]
    assert arm.length_m.tolist() == pytest.approx([0.042, 0.042])
    assert arm.link_m.tolist() == pytest.approx([0.005, 0.0])
    # A chamber with pressure bends its section away from itself; its place is that of Table I, p1 at +x.
    away = np.radians(180.0 + np.array([0.0, 120.0, 240.0] * 2))
    assert np.allclose(arm.directions, np.column_stack([np.cos(away), np.sin(away)]), atol=1e-6)


def test_arcs_need_chambers() -> None:
    with pytest.raises(ContidError, match="--form map"):
        tip_motion("finger", load_named("finger").driven["finger"], [], [], "", "arcs")
