"""The kinematics of an arm with its identified error, beside a plant by the literal equations with it."""

import numpy as np
import pytest

from contid.kinematics.batch import Targets, forward_many, inverse_many
from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.pneumatic.sense import LoadSensing, ModelErrors, Sense
from contid.robot_file.pneumatic.simulated import SimulatedArm, SimulatedErrors
from contid.targets import Target
from contid_dynamics.arm_body import SimulatedBody
from tests.sense.observed import GRAM_N, calibrated, pascal
from tests.sense.plant import shipped_robot

ERRORS = SimulatedErrors(modulus_percent=(4.0, -3.0), moment_percent=-2.0, regulator_bar=0.03, seed=7)
LOAD_N = (0.4 * GRAM_N, -0.3 * GRAM_N, 4.0 * GRAM_N)


class Plant(SimulatedBody):
    """The plant under a constant force."""

    def payload_n(self, t_s):
        return LOAD_N

    def tip_at(self, actuation):
        self.follow(list(actuation))
        return np.array(self.tip_in_world_m(0.0))


def plant():
    return Plant(shipped_robot().model_copy(update={"sim": SimulatedArm(errors=ERRORS)}))


def corrected(corrects="robot", **changes):
    """The shipped arm with exactly the errors of the plant."""
    rows = tuple((0.0,) * k + (0.01,) for k in range(22))
    keys = {
        "offset_bar": tuple(plant()._offset), "gain": (0.0,) * 6, "loop_bar": (0.0,) * 6,
        "modulus": (0.04, -0.03), "moment": (-0.02, -0.02), "axis_sigma_bar": 0.001, "tip_sigma_mm": 0.1,
        "covariance_factor": rows, "corrects": corrects,
    }  # fmt: skip
    errors = ModelErrors.model_validate({**keys, **changes})
    sense = Sense(load=LoadSensing(calibration=errors))
    return Cosserat.model_validate(shipped_robot().model_copy(update={"sense": sense}).model_dump())


GAINS = (0.02, -0.03, 0.01, 0.0, -0.01, 0.04)


@pytest.fixture(scope="module")
def pressures():
    return [tuple(pascal(row)) for row in np.random.default_rng(2).uniform(0.1, 1.1, (6, 6))]


def test_it_meets_the_plant_where_the_file_alone_misses_it(pressures):
    body, model, file = plant(), CosseratModel(corrected()), CosseratModel(shipped_robot())
    for q in pressures:
        tip = body.tip_at(q)
        assert np.linalg.norm(np.array(model.forward(q, LOAD_N).tip_m) - tip) < 5e-5
        assert np.linalg.norm(np.array(file.forward(q, LOAD_N).tip_m) - tip) > 5e-4


def test_the_plant_reaches_targets_by_its_answers(pressures):
    body, model = plant(), CosseratModel(corrected())
    for q in pressures:
        target = Target(tip_m=tuple(body.tip_at(q).tolist()), load_n=LOAD_N)
        found = model.inverse(target, q)
        assert found.converged
        assert all(0.0 <= p <= top for p, top in zip(found.actuation, model.upper, strict=True))
        assert np.linalg.norm(body.tip_at(found.actuation) - target.tip_m) < 5e-5


def test_pressures_and_derivatives_are_those_of_the_regulators(pressures):
    model = CosseratModel(corrected(gain=GAINS))
    for q in pressures[:2]:
        analytic = model.jacobian(q, LOAD_N)
        for k in range(6):
            up, down = ([p + (step if i == k else 0.0) for i, p in enumerate(q)] for step in (50.0, -50.0))
            tips = [np.array(model.forward(tuple(each), LOAD_N).tip_m) for each in (up, down)]
            assert (tips[0] - tips[1]) / 100.0 == pytest.approx(analytic[:, k], rel=1e-3, abs=1e-11)


def test_limits_are_those_of_the_regulators():
    model = CosseratModel(corrected(gain=GAINS))
    found = model.inverse(Target(tip_m=(0.2, 0.1, 0.2)), (0.0,) * 6)
    assert not found.converged
    ends = {name for name in found.limited_by if name.endswith(("min", "max"))}
    assert ends
    for name in ends:
        axis, _, end = name.rpartition(".")
        k = model.axis_names.index(axis)
        assert found.actuation[k] == (model.lower if end == "min" else model.upper)[k]


def test_rows_are_as_single_calls(pressures):
    model = CosseratModel(corrected(gain=GAINS))
    q = np.array(pressures)
    poses = forward_many(model, q)
    singles = [model.forward(each) for each in pressures]
    tips = poses["tip_m"]
    assert tips.tolist() == [list(each.tip_m) for each in singles]
    found = inverse_many(model, Targets(tip_m=tips), q)
    answers = [
        model.inverse(Target(tip_m=pose.tip_m), each) for pose, each in zip(singles, pressures, strict=True)
    ]
    # Rows of a batch without load sum the same integrals in another order: up to 2e-6 bar.
    np.testing.assert_allclose(
        found.rows["actuation"], [each.actuation for each in answers], rtol=0, atol=0.2
    )


def test_without_the_key_the_robot_bends_as_its_geometry_states(pressures):
    file = CosseratModel(shipped_robot())
    for robot in (corrected("estimate"), corrected("estimate", gain=GAINS)):
        model = CosseratModel(robot)
        for q in pressures:
            pose = model.forward(q, LOAD_N)
            assert pose == file.forward(q, LOAD_N)
            target = Target(tip_m=pose.tip_m, load_n=LOAD_N)
            assert model.inverse(target, q) == file.inverse(target, q)


def test_errors_are_identified_from_the_geometry_also_of_a_corrected_arm(pressures):
    q = pressures[0]
    file, plain = (
        CosseratModel(shipped_robot()),
        scaled_arm(corrected(), SectionErrors((0.0, 0.0), (0.0, 0.0))),
    )
    assert CosseratModel(plain).forward(q) == file.forward(q)


def test_a_calibration_written_now_corrects_the_robot(pressures):
    body = plant()
    body.payload_n = lambda t_s: (0.0, 0.0, 0.0)
    robot = calibrated(body, np.random.default_rng(1), 24)
    model, file = CosseratModel(robot), CosseratModel(shipped_robot())
    off = []
    for q in pressures:
        tip = body.tip_at(q)
        off.append([np.linalg.norm(np.array(each.forward(q).tip_m) - tip) for each in (file, model)])
    without, with_it = np.sqrt((np.array(off) ** 2).mean(axis=0))
    assert with_it < 0.05 * without


def test_an_impossible_error_is_refused():
    with pytest.raises(ValueError, match=r"calibration\.gain: parts of the whole, between -0.9 and 0.9"):
        corrected(gain=(0.0, 0.0, -1.0, 0.0, 0.0, 0.0))
