"""Maps of compliance, accuracy and dexterity, against differences and random errors of forward kinematics."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure
from PIL import Image

from contid.cli.main import cli
from contid.errors import ContidError
from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm
from contid.kinematics.model import Model, build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation, Target
from contid.units import BAR
from contid_reach.quality import Measure, QualityMap, quality_map
from contid_reach.quality_plot import section

PLACES = 5


@pytest.fixture(scope="module", autouse=True)
def fonts() -> None:
    """Matplotlib never closes its font files; open them before descriptors are counted."""
    figure = Figure()
    figure.text(0.0, 0.0, "x³")
    figure.savefig(BytesIO())


def robot_of(name: str) -> RobotDescription:
    return next(iter(load_named(name).file.robots.values()))


def places(
    name: str, measure: Measure, across: int, axis_sigma: float | None = None
) -> Iterator[tuple[Model, Actuation, float]]:
    """A few places of a map: model, actuation, value in edge units."""
    robot = robot_of(name)
    found = quality_map(name, robot, measure, axis_sigma=axis_sigma, across=across)
    model = build_model(robot)
    chosen = np.random.default_rng(3).choice(len(found.values), PLACES, replace=False)
    for index in chosen:
        # Base frames of these robots are the world frame.
        x, y, z = found.points_m[index].tolist()
        answer = model.inverse(Target(tip_m=(x, y, z)), middle(model))
        assert answer.converged
        yield model, answer.actuation, float(found.values[index])


def middle(model: Model) -> Actuation:
    return tuple((0.5 * np.add(model.lower, model.upper)).tolist())


def test_the_compliance_is_the_greatest_motion_of_the_tip_per_force() -> None:
    rng = np.random.default_rng(1)
    for model, actuation, value in places("stiffflop1", Measure.COMPLIANCE, 6):
        directions = rng.normal(size=(300, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        force_n = 1e-3
        tips = [
            np.subtract(
                model.forward(actuation, tuple(force_n * d)).tip_m,
                model.forward(actuation, tuple(-force_n * d)).tip_m,
            )
            for d in directions
        ]
        greatest = np.linalg.norm(tips, axis=1).max() / (2.0 * force_n)
        assert value == pytest.approx(1e3 * greatest, rel=0.02)


def test_the_accuracy_is_the_spread_of_tips_under_random_errors_of_the_axes() -> None:
    rng, sigma = np.random.default_rng(2), 1e-4
    for model, actuation, value in places("hand", Measure.ACCURACY, 10, sigma):
        errors = rng.normal(scale=sigma, size=(4000, len(actuation)))
        tips = np.array([model.forward(tuple(actuation + e)).tip_m[:2] for e in errors])
        worst = math.sqrt(float(np.linalg.eigvalsh(np.cov(tips.T))[-1]))
        assert value == pytest.approx(1e3 * worst, rel=0.05)


def test_the_dexterity_is_the_ratio_of_slowest_to_fastest_direction() -> None:
    for model, actuation, value in places("trirack", Measure.DEXTERITY, 8):
        travel, step = np.subtract(model.upper, model.lower), 1e-6
        columns = [
            np.subtract(
                model.forward(tuple(actuation + step * axis)).tip_m,
                model.forward(tuple(actuation - step * axis)).tip_m,
            )
            for axis in np.diag(travel)
        ]
        singular = np.linalg.svd(np.array(columns).T, compute_uv=False)
        assert value == pytest.approx(singular[-1] / singular[0], rel=1e-4)


CALIBRATION = """
    sense:
      load:
        calibration:
          offset_bar: [0.01, -0.01, 0.0]
          gain: [0.0, 0.01, 0.0]
          loop_bar: [0.01, 0.01, 0.01]
          modulus: [0.02]
          moment: [-0.01]
          axis_sigma_bar: 0.004
          tip_sigma_mm: 0.1
          covariance_factor: FACTOR
"""


def test_the_accuracy_of_a_calibrated_arm_is_the_spread_that_its_calibration_leaves(configs: Path) -> None:
    sigmas = [0.01] * 3 + [0.005] * 3 + [0.002] * 3 + [0.02, 0.01]
    factor = [[0.0] * k + [sigma] for k, sigma in enumerate(sigmas)]
    text = (configs / "stiffflop1.yaml").read_text(encoding="utf-8")
    text = text.replace(
        "    model: cosserat", "    model: cosserat" + CALIBRATION.replace("FACTOR", str(factor))
    )
    (robot,) = parse_robot_file(text, "arm.yaml").file.robots.values()
    assert isinstance(robot, Cosserat)
    found = quality_map("arm", robot, Measure.ACCURACY, across=6)
    index, rng = len(found.values) // 3, np.random.default_rng(4)
    model = build_model(robot)
    x, y, z = found.points_m[index].tolist()
    p = np.array(model.inverse(Target(tip_m=(x, y, z)), middle(model)).actuation) / BAR
    away = p - 0.5 * np.add(model.lower, model.upper) / BAR
    tips = []
    for numbers in rng.normal(scale=sigmas, size=(600, len(sigmas))):
        offset, gain, loop, modulus, moment = np.split(numbers, [3, 6, 9, 10])
        side = rng.uniform(-1.0, 1.0, 3)
        used = p + [0.01, -0.01, 0.0] + offset + (np.array([0.0, 0.01, 0.0]) + gain) * away
        used = used + (0.01 + loop) * side + rng.normal(scale=0.004, size=3)
        arm = build_model(
            scaled_arm(robot, SectionErrors((0.02 + modulus).tolist(), (-0.01 + moment).tolist()))
        )
        tips.append(np.array(arm.forward(tuple(used * BAR)).tip_m) + rng.normal(scale=1e-4, size=3))
    worst = math.sqrt(float(np.linalg.eigvalsh(np.cov(np.array(tips).T))[-1]))
    assert found.values[index] == pytest.approx(1e3 * worst, rel=0.1)


def test_a_section_has_the_values_of_its_plane() -> None:
    cells = np.array([(i, j, k) for i in range(4) for j in range(-1, 2) for k in range(3)], dtype=float)
    found = QualityMap(Measure.DEXTERITY, 0.01 * cells, cells @ (1.0, 100.0, 10.0), 0.01, planar=False)
    x, z, values, where = section(found, 0, 2)
    assert where == "y = 0 mm"
    assert x.tolist() == pytest.approx([0.0, 10.0, 20.0, 30.0])
    assert z.tolist() == pytest.approx([0.0, 10.0, 20.0])
    assert values.tolist() == [[0.0, 1.0, 2.0, 3.0], [10.0, 11.0, 12.0, 13.0], [20.0, 21.0, 22.0, 23.0]]


def test_a_section_is_through_places_where_the_median_is_between_them() -> None:
    """An arm of fixed length reaches a shell: of a coarse grid few places, and planes without one."""
    places_m = np.array([[0.0, -0.02, 0.05], [0.01, -0.02, 0.05], [0.0, 0.02, 0.05], [0.01, 0.02, 0.05]])
    found = QualityMap(Measure.DEXTERITY, places_m, np.array([0.1, 0.2, 0.3, 0.4]), 0.01, False)
    x, z, values, where = section(found, 0, 2)
    assert where == "y = -20 mm"
    assert (x.tolist(), z.tolist(), values.tolist()) == ([0.0, 10.0], [50.0], [[0.1, 0.2]])


@pytest.mark.parametrize(
    ("robot", "measure", "message"),
    [
        ("hand", Measure.COMPLIANCE, "does not bend under a load"),
        ("trirack", Measure.ACCURACY, "--axis-sigma, the standard deviation of an axis in mm"),
        ("stiffflop1", Measure.ACCURACY, "in bar, or sense.load.calibration"),
    ],
)
def test_what_a_model_cannot_have_is_refused(robot: str, measure: Measure, message: str) -> None:
    with pytest.raises(ContidError, match=message):
        quality_map("arm", robot_of(robot), measure)


def test_the_command_prints_and_draws_every_robot(tmp_path: Path) -> None:
    drawn = tmp_path / "map.png"
    done = CliRunner().invoke(
        cli, ["reach", "hand", "--quality", "dexterity", "--across", "8", "--plot", str(drawn)]
    )
    assert done.exit_code == 0, done.output
    assert "left: dexterity at" in done.stdout
    assert "right: dexterity at" in done.stdout
    with Image.open(drawn) as image:
        assert image.size[0] > 300
    numbers = CliRunner().invoke(cli, ["reach", "hand", "--quality", "dexterity", "--across", "8", "--json"])
    found = json.loads(numbers.stdout)["robots"]["left"]
    assert len(found["values"]) == len(found["points_mm"])
    assert found["least"] == min(found["values"])
    refused = CliRunner().invoke(cli, ["reach", "hand", "--axis-sigma", "1"])
    assert refused.exit_code == 2
    assert "--axis-sigma is for --quality accuracy" in refused.stderr
