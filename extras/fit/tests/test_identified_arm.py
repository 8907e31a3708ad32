"""The identified error of an arm and what it leaves uncertain, by differences and by samples."""

import numpy as np
import pytest

from contid import kernels
from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
from contid.units import BAR
from contid_fit.identified_arm import HALF_LOOP_RANGE, IdentifiedArm
from tests.sense.plant import shipped_robot

pytestmark = pytest.mark.skipif(kernels.load("cosserat") is None, reason="NumPy takes minutes")

PRESSURES = (0.9, 0.2, 0.4, 0.3, 0.8, 0.5)
SIDES = (1.0, -0.5, 0.2, -1.0, 0.0, 0.7)
FORCE = (0.01, -0.02, 0.05)
AXIS_BAR, TIP_MM = 0.004, 0.2
#: Offsets, gains and loops of six axes, moduli and moments of two sections.
NUMBERS = np.array(
    [
        *(0.03, -0.02, 0.01, 0.0, -0.03, 0.02, 0.02, -0.03, 0.01, 0.0, -0.01, 0.04),
        *(0.02, 0.01, 0.0, 0.015, -0.02, 0.03, 0.04, -0.03, -0.02, 0.01),
    ]
)


def arm_of(numbers, factor=None):
    offset, gain, loop, modulus, moment = (tuple(part) for part in np.split(numbers, [6, 12, 18, 20]))
    rows = np.zeros((22, 22)) if factor is None else factor
    errors = ModelErrors(
        offset_bar=offset, gain=gain, loop_bar=loop, modulus=modulus, moment=moment,
        axis_sigma_bar=AXIS_BAR, tip_sigma_mm=TIP_MM,
        covariance_factor=tuple(tuple(row[: i + 1]) for i, row in enumerate(rows.tolist())),
    )  # fmt: skip
    sense = Sense(load=LoadSensing(calibration=errors))
    return IdentifiedArm(shipped_robot().model_copy(update={"sense": sense}))


def near(arm, pressures=PRESSURES, sides=SIDES, scale=-1):
    corrected = arm.corrected(pressures, sides)
    moment = arm.base_moment(corrected, FORCE)
    assert moment is not None
    found = arm.near(corrected, FORCE, moment, scale)
    assert found is not None
    return found


def tip_of(arm, **keys):
    return np.array(near(arm, **keys).tip_mm)


def derivatives(arm):
    """Of the tip, by pressures [mm/bar] and by the scales of moduli and moments [mm]."""
    here = near(arm)
    by_scale = [(tip_of(arm, scale=k) - np.array(here.tip_mm)) / arm.steps[k] for k in range(arm.scales)]
    return np.array(here.by_pressure_mm_bar).reshape(3, -1), np.array(by_scale).T


def test_it_is_the_model_with_other_sections_at_other_pressures():
    robot = shipped_robot()
    middle = 0.5 * (np.array(robot.lower) + np.array(robot.upper)) / BAR
    offset, gain, loop, modulus, moment = np.split(NUMBERS, [6, 12, 18, 20])
    chambers = np.array(PRESSURES) + offset + gain * (np.array(PRESSURES) - middle) + loop * np.array(SIDES)
    model = CosseratModel(scaled_arm(robot, SectionErrors(modulus.tolist(), moment.tolist())))
    expected = 1e3 * np.array(model.forward(tuple((BAR * chambers).tolist()), FORCE).tip_m)
    # Six steps per section, without the doubling of the model.
    assert tip_of(arm_of(NUMBERS)) == pytest.approx(expected, abs=0.02)


def test_scales_are_those_of_moduli_and_moments_in_their_order():
    arm = arm_of(NUMBERS)
    assert arm.scales == 4
    for scale in range(4):
        raised = NUMBERS.copy()
        raised[18 + scale] += arm.steps[scale]
        assert tip_of(arm, scale=scale) == pytest.approx(tip_of(arm_of(raised)), abs=1e-6)


def test_the_covariance_is_that_of_the_numbers_of_the_calibration():
    rng = np.random.default_rng(1)
    factor = np.tril(rng.normal(0.0, 1e-3, (22, 22)))
    arm = arm_of(NUMBERS, factor)
    by_pressure, by_scale = derivatives(arm)
    by_number = []
    for k in range(22):
        step = np.zeros(22)
        step[k] = 1e-4
        by_number.append((tip_of(arm_of(NUMBERS + step)) - tip_of(arm_of(NUMBERS - step))) / 2e-4)
    spread = np.array(by_number).T @ factor
    expected = spread @ spread.T + AXIS_BAR**2 * by_pressure @ by_pressure.T + TIP_MM**2 * np.eye(3)
    found = arm.covariance_mm2(PRESSURES, SIDES, by_pressure, by_scale)
    assert found == pytest.approx(expected, rel=1e-2, abs=1e-3 * np.trace(expected))


def test_an_unknown_side_is_anywhere_between_the_branches():
    arm, rng = arm_of(NUMBERS), np.random.default_rng(2)
    by_pressure, _ = derivatives(arm)
    unknown = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    sides = rng.uniform(-1.0, 1.0, (50_000, 6)) * unknown
    moved = np.array([arm.corrected(PRESSURES, each) for each in sides.tolist()]) @ by_pressure.T
    expected = np.cov(moved.T)
    found = arm.sides_mm2(tuple(unknown), by_pressure)
    assert found == pytest.approx(expected, abs=0.03 * np.trace(expected))


def test_the_play_of_an_axis_is_half_its_loop_within_bounds():
    robot = shipped_robot()
    travel = (np.array(robot.upper) - np.array(robot.lower)) / BAR
    half = np.array(arm_of(NUMBERS).half_loop)
    least, most = (part * travel for part in HALF_LOOP_RANGE)
    assert np.all(half >= least)
    assert np.all(half <= most)
    loop = np.abs(NUMBERS[12:18])
    inside = (loop > least) & (loop < most)
    assert inside.any()
    assert half[inside] == pytest.approx(loop[inside])


def test_the_base_moment_is_that_of_an_equilibrium_and_none_where_there_is_no_stable_one():
    arm = arm_of(NUMBERS)
    corrected = arm.corrected(PRESSURES, SIDES)
    moment = arm.base_moment(corrected)
    assert moment is not None
    unloaded = arm.near(corrected, (0.0, 0.0, 0.0), moment)
    assert unloaded is not None
    assert unloaded.base_moment_nmm == pytest.approx(moment, abs=1e-6)
    under = arm.base_moment(corrected, FORCE)
    assert under is not None
    loaded = arm.near(corrected, FORCE, under)
    assert loaded is not None
    assert loaded.base_moment_nmm == pytest.approx(under, abs=1e-4)
    crushed = (0.0, 0.0, -20.0)
    assert arm.base_moment(corrected, crushed) is None
