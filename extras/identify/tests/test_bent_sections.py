"""Bends of sections that brace one another: recovered from tips of a plant written apart, with intervals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.load import load_robot_file
from contid_identify.answer import CommandedTrace
from contid_identify.printed import motion_lines
from contid_identify.sections.bent import ArmSections
from contid_identify.sections.fit import LoadedInputs, fit_bent, sections_of, start_of, tips_of
from contid_identify.stages import tip_motion
from contid_identify.tip_fit.tip_map import TipMap
from contid_identify.tip_fit.trace_rows import LoadedTrace, TraceRows
from contid_identify.tip_motion import TipMotion
from contid_identify.tip_motion_file import read_tip_motion, write_tip_motion
from contid_identify.tip_motion_fit import fit_tip_motion

PERIOD_S = 0.02
CONFIGS = Path(__file__).parents[3] / "configs"
LENGTHS = np.array([0.1, 0.12])
#: Axes 1 and 2 bend the first section, 3 and 4 the second; tendons of the second pass the first.
GAINS = np.array(
    [
        [[0.5, 0.1], [-0.2, 0.0]],
        [[-0.1, 0.4], [0.0, -0.2]],
        [[0.0, 0.1], [0.7, 0.2]],
        [[0.1, 0.0], [-0.2, 0.8]],
    ]
)
CUBES = np.array([0.1, -0.1, 0.2, 0.0])
BRACED = np.zeros((2, 2, 2))
BRACED[0, 1, 0], BRACED[1, 1, 1], BRACED[1, 0, 1] = 0.5, 0.3, -0.2


def tips_by_steps(bends: Array) -> Array:
    """Tips of arcs ``(n, sections, 2)`` walked in 200 turns of frames each: no formula of arcs in it."""
    frame, tip = np.tile(np.eye(3), (len(bends), 1, 1)), np.zeros((len(bends), 3))
    for section, length_m in enumerate(LENGTHS):
        turn = np.column_stack([-bends[:, section, 1], bends[:, section, 0], np.zeros(len(bends))]) / 200
        size = np.linalg.norm(turn, axis=1)[:, None, None]
        cross = np.zeros((len(bends), 3, 3))
        cross[:, 0, 2], cross[:, 2, 0] = turn[:, 1], -turn[:, 1]
        cross[:, 1, 2], cross[:, 2, 1] = -turn[:, 0], turn[:, 0]
        half = np.eye(3) + 0.5 * np.sinc(0.5 * size / np.pi) * cross  # half a turn, to first order in it
        step = (
            np.eye(3) + np.sinc(size / np.pi) * cross + 0.5 * np.sinc(0.5 * size / np.pi) ** 2 * cross @ cross
        )
        for _ in range(200):
            tip += length_m / 200 * (frame @ half)[:, :, 2]
            frame = frame @ step
    return tip


def plant(y: Array, load_kg: float = 0.0) -> Array:
    """Tips [m] of axes in spreads; loops in place of the sums of arrays of the model."""
    bends = np.zeros((len(y), 2, 2))
    for n, row in enumerate(y):
        free = [sum(row[a] * GAINS[a, k] for a in range(4)) for k in range(2)]
        for i in range(2):
            bends[n, i] = sum((row[a] + CUBES[a] * row[a] ** 3) * GAINS[a, i] for a in range(4))
            for j in range(2):
                for k in range(2):
                    bends[n, i] -= BRACED[i, j, k] * np.hypot(*free[j]) * free[k]
            bends[n, i] -= load_kg * 0.4 * free[i]
    return tips_by_steps(bends)


def arm(factor: float = 0.8) -> ArmSections:
    """What a robot file would have: gains that are too small, the turn of one section left out."""
    gains = factor * GAINS.transpose(1, 2, 0)
    gains[0, :, 2:], gains[1, :, :2] = 0.0, 0.0
    return ArmSections(LENGTHS, np.zeros(2), gains, np.zeros((2, 2)), np.zeros(3), np.eye(3))


def data_of(seed: int, count: int = 900) -> LoadedInputs:
    """Smooth axes, and tips with 0.5 mm of noise that lasts for five samples."""
    draw = np.random.default_rng(seed)
    y = np.array([np.convolve(column, np.hanning(40), "same") for column in draw.normal(size=(4, count))]).T
    y *= 0.5 / y.std(axis=0)
    noise = np.repeat(draw.normal(0.0, 0.5e-3, (count // 5, 3)), 5, axis=0)
    return LoadedInputs(y, np.zeros(count), plant(y) + noise, np.arange(float(count)) // 30)


@pytest.mark.parametrize("plants", [2, pytest.param(8, marks=pytest.mark.campaign)])
def test_numbers_and_their_intervals(plants: int) -> None:
    """Every interval of the known numbers, 12 of each plant."""
    start = start_of(arm(), np.eye(4), np.zeros(4), np.ones(4))
    held = total = 0
    for seed in range(plants):
        data = data_of(seed)
        found = fit_bent(start, data, 0.0, 10.0)
        assert np.abs(found.braced - BRACED).max() < 0.15
        assert np.sqrt(((tips_of(found, data) - data.tips) ** 2).sum(axis=1).mean()) < 1e-3
        for value, half, truth in (
            (found.cubes, found.cube_halves, CUBES),
            (found.braced, found.braced_halves, BRACED),
        ):
            held += int((np.abs(value - truth) <= half).sum())
            total += truth.size
    print(f"{held} of {total} intervals hold")
    assert held / total >= 0.9, f"{held} of {total}"


def test_what_is_not_moved_stays_as_the_model_has_it() -> None:
    start = start_of(arm(), np.eye(4), np.zeros(4), np.ones(4))
    data = data_of(3)
    still = replace(data, inputs=data.inputs * [1.0, 1.0, 0.0, 0.0])
    still = replace(still, tips=plant(still.inputs))
    found = fit_bent(start, still, 0.0, 10.0)
    assert np.allclose(found.gains[2:], start.gains[2:], atol=1e-9)
    assert np.isfinite(found.braced).all()


def commands(seed: int, duration_s: float) -> Array:
    draw = np.random.default_rng(seed)
    at_s = np.arange(0.0, duration_s, PERIOD_S, dtype=np.float64)
    out = np.zeros((len(at_s), 4))
    for axis in range(4):
        for hz in draw.uniform(0.1, 1.0, 8):
            out[:, axis] += np.sin(2.0 * np.pi * hz * at_s + draw.uniform(0.0, 6.28))
    return np.asarray(out / 5.0 * np.minimum(at_s, 1.0)[:, None])


def trace_of(seed: int, duration_s: float, load_kg: float = 0.0) -> CommandedTrace:
    """Commands 0.1 s before their axes, without a swing."""
    sent = commands(seed, duration_s)
    late = np.concatenate([np.repeat(sent[:1], 5, axis=0), sent[:-5]])
    noise = np.random.default_rng(seed + 100).normal(0.0, 3e-4, (len(sent), 3))
    at_s = np.arange(float(len(sent))) * PERIOD_S
    return CommandedTrace(PERIOD_S, sent, at_s, plant(late, load_kg) + noise, f"seed {seed}")


@pytest.fixture(scope="module")
def models() -> tuple[TipMotion, TipMotion]:
    """With sections and without, of the same two short recordings."""
    traces = [LoadedTrace(trace_of(1, 10.0), 0.0), LoadedTrace(trace_of(2, 10.0, 0.2), 0.2)]
    with pytest.MonkeyPatch.context() as few:
        few.setattr("contid_identify.remembered.MOST", 100)
        axes = ("a", "b", "c", "d")
        return (
            fit_tip_motion("arm", axes, traces, None, "a test", arm()),
            fit_tip_motion("arm", axes, traces, None, "a test"),
        )


@pytest.mark.slow
def test_other_commands_are_predicted_better_than_by_monomials(models: tuple[TipMotion, TipMotion]) -> None:
    other = trace_of(7, 20.0, 0.1)
    off = []
    for model in models:
        tips = model.predict(other.sent, PERIOD_S, other.at_s, 0.1)
        off.append(float(np.sqrt(((tips - other.measured) ** 2).sum(axis=1)[50:].mean())))
    print(off)
    assert off[0] < 0.7 * off[1]
    assert "bends of the sections" in next(iter(motion_lines(models[0])))


def test_an_arm_that_is_not_where_its_tips_are_is_refused() -> None:
    """As of a camera's table without the place of the base: monomials took it up, and 45 mm were reported."""
    rows = TraceRows([LoadedTrace(trace_of(1, 5.0))], None)
    swings = np.tile([0.1, np.log(20.0), np.log(0.7)], 4)
    elsewhere = replace(arm(), base_m=np.array([0.1, 0.0, -0.3]))
    with pytest.raises(ContidError, match=r"not where they were measured.*origin: rest"):
        TipMap(rows).bend(swings, elsewhere)


@pytest.mark.slow
def test_the_file_holds_bends(models: tuple[TipMotion, TipMotion], tmp_path: Path) -> None:
    file, sent = tmp_path / "m.json", commands(5, 5.0)
    for model in models:
        write_tip_motion(model, file)
        assert np.array_equal(
            read_tip_motion(file).predict(sent, PERIOD_S, load_kg=0.1),
            model.predict(sent, PERIOD_S, load_kg=0.1),
        )
    write_tip_motion(models[0], file)
    text = file.read_text()
    for bad, message in (
        (text.replace('"cubes": [', '"cubes": [0.5,'), "cubes"),
        (text.replace('"sag"', '"sags"'), "sag"),
    ):
        file.write_text(bad)
        with pytest.raises(ContidError, match=message):
            read_tip_motion(file)


@pytest.mark.parametrize("name", ["tendon3", "trunk"])
def test_arms_begin_as_their_robot_file_has_them(name: str) -> None:
    (robot,) = load_robot_file(CONFIGS / f"{name}.yaml").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, TendonModel)
    lower, upper = np.array(model.lower), np.array(model.upper)
    draw = np.random.default_rng(4).uniform(0.2, 0.4, (20, len(lower)))
    sent = lower + draw * (upper - lower)
    start = start_of(sections_of(model), np.eye(len(lower)), np.zeros(len(lower)), np.ones(len(lower)))
    tips = start.tips(sent, 0.0)
    assert tips == pytest.approx(np.array([model.forward(row).tip_m for row in sent]), abs=1e-9)


def test_only_arms_of_tendons_have_such_bends() -> None:
    (robot,) = load_robot_file(CONFIGS / "cbha.yaml").file.robots.values()
    with pytest.raises(ContidError, match="model: tendon"):
        tip_motion("cbha", robot, [], [], "", "bends")
