"""`Robot.compliance` against differences of `fk`, the cantilever of a textbook, and its symmetry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from contid import Robot
from contid.errors import ContidError
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.load import configs_folder

PRESSURES = {
    "stiffflop1": [[0.0, 0.0, 0.0], [0.9, 0.2, 0.1], [0.4, 1.0, 0.7]],
    "stiffflop2": [[0.0] * 6, [0.2, 0.4, 0.6, 0.1, 0.1, 0.8], [0.9, 0.1, 0.2, 0.3, 0.7, 0.1]],
}


def differences(robot: Robot, rows: np.ndarray, load: np.ndarray, step_n: float) -> np.ndarray:
    columns = []
    for axis in range(3):
        force = np.zeros(3)
        force[axis] = step_n
        more, less = robot.fk(rows, load=load + force).tip, robot.fk(rows, load=load - force).tip
        columns.append((more - less) / (2.0 * step_n))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("name", PRESSURES)
@pytest.mark.parametrize("load", [(0.0, 0.0, 0.0), (0.0, 0.004, 0.01)])
def test_it_is_the_derivative_by_the_load_and_symmetric(name: str, load: tuple[float, float, float]) -> None:
    robot, rows = Robot(name), np.array(PRESSURES[name])
    found = robot.compliance(rows, load=load)
    expected = differences(robot, rows, np.array(load), 1e-5)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    # Both have the discretisation error of the statics, 0.03 mm of some 100 mm.
    assert (np.abs(found - expected) / scale).max() < 5e-3
    assert np.max(np.abs(found - found.swapaxes(1, 2)) / scale) < 5e-4
    # A force does work on its tip: positive definite in stable equilibrium.
    assert np.min(np.linalg.eigvalsh(0.5 * (found + found.swapaxes(1, 2)))) > 0.0


def test_without_pressure_it_is_the_cantilever_of_timoshenko() -> None:
    robot = Robot("stiffflop1")
    assert isinstance(robot._model, CosseratModel)
    (section,) = robot._model.setup.rod.sections
    inflated = section.inflated(np.zeros(3))
    sideways = inflated.bend * section.length**3 / 3.0 + inflated.shear * section.length
    expected = np.diag([sideways, sideways, inflated.axial * section.length])
    assert np.allclose(robot.compliance([0.0, 0.0, 0.0]), expected, rtol=1e-6, atol=1e-9 * sideways)


def test_a_tilted_base_turns_it_and_si_scales_it(tmp_path: Path) -> None:
    text = (configs_folder() / "stiffflop1.yaml").read_text()
    tilted = tmp_path / "tilted.yaml"
    model = "    model: cosserat\n"
    tilted.write_text(text.replace(model, model + "    base: {roll_deg: 90, x_mm: 7}\n"))
    row = [0.9, 0.2, 0.1]
    found = Robot(tilted).compliance(row)
    upright = Robot("stiffflop1").compliance(row)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    assert np.allclose(found, turn @ upright @ turn.T)
    assert np.allclose(Robot("stiffflop1", si=True).compliance(np.array(row) * 1e5), upright * 1e-3)


def test_a_model_that_does_not_bend_is_named() -> None:
    with pytest.raises(ContidError, match="compliance: model tri_rack of arm does not bend under a load"):
        Robot("trirack2").compliance([10.0] * 6)
