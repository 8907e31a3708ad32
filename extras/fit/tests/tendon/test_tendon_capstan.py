"""The friction of the bends from a recording of an emulated robot whose tendons stick and slip."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.kinematics.tendon.geometry import TendonGeometry, forward
from contid_emulate.dynamixel.servo import Servo
from contid_emulate.dynamixel.tendon_friction import FrictionPlant
from contid_fit.calibrate.tendon.capstan import capstan_coefficient
from contid_fit.calibrate.tendon.fit import fit_model
from contid_fit.calibrate.tendon.models import ElasticBends, Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording
from tests.support.tendon_sections import even_section

MU, PLAY_M = 0.15, 0.1e-3
TIGHT_M = 0.3e-3
#: Ticks of the emulated spools per metre.
PER_M = 65e3


def recording() -> tuple[Nominal, TendonRecording]:
    """Swings of both sections in sixteen directions, from the emulated bends."""
    sections = (even_section(0.06, 4e-3), even_section(0.05, 4e-3, first_rad=1.0))
    geometry = TendonGeometry(sections)
    matrix = geometry.pull_matrix * PER_M
    bending = np.repeat([6e-6, 9e-6], 2) * PER_M**2
    servos = [
        Servo(k, baud=57600, model=1200, position_ticks=0.0, stops_ticks=(-1e6, 1e6)) for k in range(1, 7)
    ]
    plant = FrictionPlant(
        *(servos, (1,) * 6, (0.0,) * 6, (1.0,) * 6, matrix, bending.tolist()),
        backlash_ticks=(PLAY_M * PER_M,) * 6,
        capstan=(MU,) * 2,
    )
    random, rows, labels, bends = np.random.default_rng(3), [], [], []
    swing = np.concatenate((np.linspace(0.1, 1.0, 8), np.linspace(0.9, 0.0, 8)))
    for run in range(16):
        first, second = random.uniform(0.0, 2.0 * math.pi, 2)
        sizes = [(0.8, 0.0), (0.0, 0.8), (0.6, 0.6)][run % 3]
        goal = np.concatenate(
            [s * np.array([math.cos(a), math.sin(a)]) for s, a in zip(sizes, (first, second), strict=True)]
        )
        for part in swing:
            pull = part * 1.2 * geometry.pulls(goal) + TIGHT_M
            for servo, each in zip(servos, pull, strict=True):
                servo.motion.position = float(each * PER_M)
            rows.append(pull)
            labels.append(f"run {run}")
            bends.append(plant.bends)
    tips = forward(geometry, np.array(bends)).tip_m + 1e-4 * random.normal(size=(len(rows), 3))
    names = tuple(f"servo_{k}_mm" for k in range(1, 7))
    data = TendonRecording("emulated", tuple(labels), names, np.array(rows), tips)
    angles = np.concatenate([section.angle_rad for section in sections])
    return Nominal((0.06, 0.05), 4e-3, angles, (3, 3)), data


@pytest.mark.slow
def test_the_coefficient_is_that_of_the_emulated_tendons() -> None:
    """The fit has a constant moment per section: the quotient of works is right to a fifth."""
    nominal, data = recording()
    fit = fit_model(ElasticBends(nominal), data)
    found = capstan_coefficient(fit, data.pull_m)
    assert found is not None
    assert found.low < found.value < found.high
    assert abs(found.value / MU - 1.0) < 0.3
    few = data.rows(0, 48)
    assert capstan_coefficient(fit_model(ElasticBends(nominal, friction=False), few), few.pull_m) is None
