"""Parameters of a robot that another program simulates are found inside their intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.geometry import find_geometry, nominal_of
from contid_fit.calibrate.tendon.models import ElasticBends
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage, run_stages
from tests.calibrate.tendon_links import LinkRobot

pytestmark = pytest.mark.campaign

RADIUS_M = 4e-3
LENGTH_M = (0.060, 0.050)
ANGLES = np.array([0.0, 2.0, 4.1, 1.0, 3.2, 5.2])
NOISE_M = 0.2e-3


def robot(sheaths: bool) -> LinkRobot:
    """Drawn around what a builder expects."""
    random = np.random.default_rng(7)
    return LinkRobot(
        np.array(LENGTH_M) + random.normal(size=2) * 2e-3,
        RADIUS_M * (1.0 + 0.07 * random.normal(size=6)),
        ANGLES + 0.1 * random.normal(size=6),
        0.12,
        400.0,
        0.15e-3 * random.normal(size=6),
        np.array([6e-6, 9e-6]),
        0.03 * random.normal(size=4),
        np.array([4e-7, 3e-7]),
        np.array([6e-5, 4e-5]),
        sheaths,
    )


def pulls(sheaths: bool) -> tuple[Array, list[str]]:
    """Each tendon alone, others slack; then sections and both together, there and back."""
    rows, labels = [], []
    up = np.concatenate((np.linspace(-0.3e-3, 2.4e-3, 7), np.linspace(2.1e-3, -0.3e-3, 5)))
    for i in range(6):
        for each in up:
            row = np.full(6, -5e-3)
            row[i] = each
            rows.append(row)
            labels.append(f"alone {i}")
    random = np.random.default_rng(5)
    swing = np.concatenate((np.linspace(0.1, 1.0, 6), np.linspace(0.85, 0.0, 5)))
    for run in range(16):
        first, second = random.uniform(0.0, 2.0 * math.pi, 2)
        sizes = [(2.2e-3, 0.0), (0.0, 2.2e-3), (1.5e-3, 1.5e-3)][run % 3]
        bends = np.concatenate(
            [s * np.array([math.cos(a), math.sin(a)]) for s, a in zip(sizes, (first, second), strict=True)]
        )
        for part in swing:
            own = np.stack((np.cos(ANGLES), np.sin(ANGLES)), axis=1)
            far = np.arange(6) >= 3
            row = np.where(far & sheaths, 0.0, own @ bends[:2]) + np.where(far, own @ bends[2:], 0.0)
            rows.append(part * row + 0.1e-3)
            labels.append(f"run {run}")
    return np.array(rows), labels


@pytest.fixture(
    scope="module",
    params=[False, True],
    ids=["through", "sheaths"],
)
def last(request: pytest.FixtureRequest) -> tuple[LinkRobot, Stage, Stage]:
    sheaths: bool = request.param
    made = robot(sheaths)
    pull, labels = pulls(sheaths)
    tip = made.tips(pull) + NOISE_M * np.random.default_rng(1).normal(size=(len(pull), 3))
    names = tuple(f"servo_{i}_mm" for i in (5, 3, 1, 2, 4, 6))
    data = TendonRecording("links", tuple(labels), names, pull, tip)
    split = labels.index("run 12")
    training, angles = data.rows(0, split), ANGLES
    if not sheaths:
        found = find_geometry(data, (3, 3))
        assert found is not None
        assert [each.servo for each in found.tendons] == list(names)
        angles = np.array([each.angle_rad for each in found.tendons])
    nominal = nominal_of(training, LENGTH_M, RADIUS_M, angles, (3, 3), not sheaths)
    stages = {each.name: each for each in run_stages(training, data.rows(split, len(data)), nominal)}
    return made, stages["+ offsets"], stages["+ friction, play"]


def test_parameters_are_inside_their_intervals(last: tuple[LinkRobot, Stage, Stage]) -> None:
    made, _, stage = last
    assert isinstance(stage.fit.model, ElasticBends)
    parameters = stage.fit.model.parameters
    values, widths = parameters.split(stage.fit.vector), parameters.split(stage.fit.half_width)
    true = {
        "radius_m": made.radius_m,
        "angle_rad": made.angle_rad,
        "twist_rad": np.array([made.twist_rad]),
        "offset_m": made.offset_m,
        "log_stiffness": np.log(made.stiffness_m2),
        "rest_rad": made.rest_rad,
        "log_friction": np.log(made.friction_m2),
        "log_play": np.log(made.play_m),
        "length_m": made.length_m,
    }
    outside, total = [], 0
    if made.sheaths:
        del true["twist_rad"]
    for name, expected in true.items():
        off = (
            np.angle(np.exp(1j * (values[name] - expected)))
            if name == "angle_rad"
            else values[name] - expected
        )
        total += len(expected)
        outside += [
            (name, i, float(off[i]), float(widths[name][i]))
            for i in range(len(expected))
            if abs(off[i]) > widths[name][i]
        ]
    assert len(outside) <= 0.1 * total, outside
    # Intervals are narrower than what was known before.
    spread = parameters.split(parameters.spread)
    # Of a section in sheaths tips give the bend per pull, which radius and stiffness share.
    known = ("angle_rad",) if made.sheaths else ("radius_m", "angle_rad", "log_stiffness", "log_friction")
    for name in known:
        assert (widths[name] < 1.96 * spread[name]).all(), name


def test_motions_kept_out_are_predicted_near_the_noise(last: tuple[LinkRobot, Stage, Stage]) -> None:
    _, curvature, stage = last
    assert stage.held_out is not None
    assert curvature.held_out is not None
    assert stage.held_out.mean_m < 1.5e-3
    assert stage.held_out.mean_m < 0.4 * curvature.held_out.mean_m
