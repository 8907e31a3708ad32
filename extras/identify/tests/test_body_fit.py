"""Mass and damping of a body, from tips of the moving twin with other numbers, smaller steps and noise."""

from __future__ import annotations

import numpy as np
import pytest

from contid.errors import ContidError
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid_dynamics.arm import MovingArm
from contid_identify.body_fit import fit_body, scaled
from contid_identify.recording import RobotRecording
from contid_identify.ring_down import decays_of

NOISE_M = 0.3e-3
DELAY_S = 0.030


def robot() -> Cosserat:
    (found,) = load_named("stiffflop1").driven.values()
    assert isinstance(found, Cosserat)
    assert found.dynamics is not None
    heavy = found.dynamics.model_copy(update={"tip_mass_g": 15.0})
    return found.model_copy(update={"dynamics": heavy})


def recording(described: Cosserat) -> RobotRecording:
    """Two moves with rests; the body follows the devices 30 ms later, by steps of 1 ms."""
    fine_s, ticks_per = 1e-3, 5
    grid = np.arange(0.0, 5.0, fine_s)
    pressure = np.interp(grid, [0.3, 0.5, 2.7, 2.9], [2e4, 6e4, 6e4, 2e4])
    arm = MovingArm(described)
    arm.settle([2e4, 0.0, 0.0])
    tips, late = [], round(DELAY_S / fine_s)
    for k in range(len(grid)):
        tips.append(arm.tip_m)
        arm.command([float(pressure[max(k - late, 0)]), 0.0, 0.0])
        arm.rod.run(fine_s, fine_s)
    sent = np.column_stack((pressure, np.zeros((len(grid), 2))))[::ticks_per]
    at_s = np.arange(float(len(sent))) * fine_s * ticks_per
    noise = np.random.default_rng(2).normal(size=(len(grid), 3)) * NOISE_M
    measured = (np.array(tips) + noise)[::10]
    return RobotRecording(
        "synthetic", described, described.all_axis_names, fine_s * ticks_per, sent,
        (at_s,) * 3, tuple(sent.T), grid[::10], measured,
    )  # fmt: skip


@pytest.mark.slow
def test_mass_and_damping_are_found_from_wrong_numbers() -> None:
    true = robot()
    assert true.dynamics is not None
    seen = recording(true)
    wrong = true.model_copy(
        update={"dynamics": scaled(true.dynamics, 1.3, 0.6e-3 * true.dynamics.damping_ms)}
    )
    found = fit_body(wrong, [seen], [decays_of(seen, 0.0)])
    assert found.mass.value * 1.3 == pytest.approx(1.0, abs=0.05)
    assert found.damping_s.value == pytest.approx(1e-3 * true.dynamics.damping_ms, rel=0.2)
    assert found.delay_s.value == pytest.approx(DELAY_S, abs=4e-3)
    first, last = found.stages
    assert last.kept_out.rmse < 0.5 * first.kept_out.rmse
    assert last.kept_out.rmse < 3.0 * NOISE_M


def test_without_dynamics_or_decays_it_is_refused() -> None:
    (finger,) = load_named("finger").driven.values()
    with pytest.raises(ContidError, match="no `dynamics`"):
        fit_body(finger, [], [])
    with pytest.raises(ContidError, match="no ring-down"):
        fit_body(robot(), [], [])
