"""Modulus and bending gain from data made with known ones."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from contid.errors import BadInputError, ContidError
from contid.kinematics.cosserat.section import Section
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_robot_file
from contid_fit.calibrate.elongation_data import ElongationReading, read_readings
from contid_fit.calibrate.modulus import bending_deg, fit, growing_range
from contid_fit.commands import command
from studies.shi_experiments import MODULI_PA as MODULI
from tests.kinematics.cosserat_cases import section

LEVELS = np.linspace(0.1, 1.5, 15)


def readings(
    made: Section, number: int = 1, noise_mm: float = 0.0, bends: bool = False
) -> list[ElongationReading]:
    """Five trials of elongation, like the paper's, and bending with one and with two pairs."""
    rng = np.random.default_rng(4)
    rows: list[Any] = []
    for trial in range(5):
        for x in LEVELS:
            stretch = made.inflated(np.full(3, x)).strain * made.length
            measured = stretch + noise_mm * float(rng.normal())
            rows.append(ElongationReading(len(rows) + 2, number, str(trial), (x, x, x), measured, None))
    for x in LEVELS if bends else ():
        for p in ((x, 0.0, 0.0), (0.0, x, x)):
            rows.append(ElongationReading(len(rows) + 2, number, "", p, None, bending_deg(made, np.array(p))))
    return rows


@pytest.mark.parametrize("kind", [0, 1])
def test_exact_data_give_the_polynomial_back(kind: int) -> None:
    found = fit(section(0), 1, readings(section(kind)))
    assert np.allclose(found.modulus_pa, MODULI[kind], rtol=1e-8)
    assert found.rmse_elongation_mm < 1e-9
    assert found.rmse_modulus_pa < 1e-6
    assert found.trials == 5
    assert found.levels == 15
    assert found.bending_gain is None


@pytest.mark.parametrize("kind", [0, 1])
def test_noisy_data_give_the_paper_s_quality(kind: int) -> None:
    """With 0.2 mm of spread the fit predicts elongations to well below it."""
    true = section(kind)
    found = fit(section(0), 1, readings(true, noise_mm=0.2))
    assert found.rmse_elongation_mm < 0.25
    refitted = replace(true, modulus_pa=found.modulus_pa)
    for x in LEVELS:
        error = (refitted.inflated(np.full(3, x)).strain - true.inflated(np.full(3, x)).strain) * 42.0
        assert abs(error) < 0.25


def test_range_where_elongation_grows() -> None:
    """Segment 2's printed polynomial is usable up to 1.996 bar, segment 1's beyond 3."""
    assert growing_range(np.array(MODULI[1]), 3.0) == pytest.approx(1.996, abs=1e-3)
    assert growing_range(np.array(MODULI[0]), 3.0) == math.inf


def test_bending_gain() -> None:
    true = section(0, bending_gain=1.393)
    found = fit(section(0), 1, readings(true, bends=True))
    assert found.bending_gain == pytest.approx(1.393, abs=1e-9)
    assert found.bends == 30
    assert found.rmse_bend_deg == pytest.approx(0.0, abs=1e-9)
    # The reference's variant B: at this gain one pair at 1.5 bar bends segment 1 by 205.9 degrees.
    assert bending_deg(true, np.array([1.5, 0.0, 0.0])) == pytest.approx(205.92, abs=0.02)


def test_data_that_determine_no_fit_are_refused() -> None:
    rows = readings(section(0))
    with pytest.raises(ContidError, match="4 different pressures"):
        fit(section(0), 1, [row for row in rows if row.average_bar < 0.45])
    with pytest.raises(ContidError, match="check the zero"):
        fit(section(0), 1, [replace(rows[0], elongation_mm=-0.1), *rows[1:]])
    equal = ElongationReading(99, 1, "", (0.5, 0.5, 0.5), None, 30.0)
    with pytest.raises(ContidError, match="unequal pressures"):
        fit(section(0), 1, [*rows, equal])


def test_invalid_rows_are_located() -> None:
    text = (
        "p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg,section\n"
        "0.5,0.5,0.5,9.4,,1\n"
        "0.5,0.5,0.1,9.4,,1\n"
        "0.5,0.5,0.5,long,,1\n"
        "-0.5,0.5,0.5,,4,1\n"
        "0.5,0.5,0.5,9.4,,0\n"
        "0.5,0.5\n"
    )
    with pytest.raises(BadInputError) as caught:
        read_readings(text.splitlines(), "data.csv")
    assert [(f.line, f.column) for f in caught.value.findings] == [(3, 4), (4, 4), (5, 1), (6, 6), (7, 1)]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "empty"),
        ("p1_bar,p2_bar,p3_bar,bend_deg", "a header without rows"),
        ("p1_bar,p2_bar,p3_bar\n1,1,1", "nothing measured"),
        ("p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg\n1,1,1,,", "nothing measured"),
        ("p1_bar,pressure", "unknown column"),
        ("p1_bar,p2_bar,bend_deg\n1,1,30", "give p1_bar,p2_bar,p3_bar; found none"),
        ("p1_bar,p2_bar,p3_bar,bend_deg,bend_deg", "'bend_deg' occurs twice"),
        ("p1_bar,p2_bar,p3_bar,bend_deg\n1,,1,30", "2:2: p2_bar: '' is not a finite number"),
        ("p1_bar,p2_bar,p3_bar,bend_deg\n1,1,1,-30", "2:4: bend_deg: must be 0 or more, not -30"),
    ],
)
def test_tables_without_data_are_refused(text: str, what: str) -> None:
    with pytest.raises(BadInputError, match=what):
        read_readings(text.splitlines(), "data.csv")


def test_missing_and_empty_cells_take_their_defaults() -> None:
    (reading,) = read_readings(["p3_bar,p2_bar,p1_bar,bend_deg", "0.3,0.2,0.1,4"], "data.csv")
    assert reading == ElongationReading(2, 1, "", (0.1, 0.2, 0.3), None, 4.0)
    lines = ["trial,section,p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg", ",,0.5,0.5,0.5,9,"]
    (reading,) = read_readings(lines, "data.csv")
    assert reading == ElongationReading(2, 1, "", (0.5, 0.5, 0.5), 9.0, None)


def write_csv(path: Path) -> None:
    rows = [*readings(section(0, bending_gain=1.2), 1, bends=True), *readings(section(1), 2)]
    lines = ["# made for a test", "section,trial,p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg"]
    for row in rows:
        cells = [row.section, row.trial, *row.pressures_bar, row.elongation_mm, row.bend_deg]
        lines.append(",".join("" if cell is None else str(cell) for cell in cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def fonts() -> None:
    """Matplotlib never closes its font files; open them before descriptors are counted."""
    from matplotlib.figure import Figure

    figure = Figure()
    figure.text(0.5, 0.5, "text")
    figure.savefig(BytesIO())


def test_command_writes_back_with_its_origin(tmp_path: Path, configs: Path, fonts: None) -> None:
    data, robot, figure = tmp_path / "data.csv", tmp_path / "robot.yaml", tmp_path / "fit.png"
    write_csv(data)
    shutil.copy(configs / "stiffflop2.yaml", robot)
    text = robot.read_text(encoding="utf-8").replace("bending_gain: 1.0", "bending_gain: 0.9")
    robot.write_text(text.replace("-65410", "-60000"), encoding="utf-8")
    arguments = ["modulus", str(data), "--write", str(robot), "--plot", str(figure)]
    done = CliRunner().invoke(command, arguments)
    assert done.exit_code == 0, done.output
    assert "bending_gain 1.2000" in done.output
    arm = load_robot_file(robot).file.robots["arm"]
    assert isinstance(arm, Cosserat)
    first, second = arm.geometry.sections
    assert np.allclose(first.modulus_pa, MODULI[0], atol=2e-3)
    assert np.allclose(second.modulus_pa, MODULI[1], atol=2e-3)
    assert first.bending_gain == pytest.approx(1.2, abs=1e-5)
    assert second.bending_gain == 0.9
    assert second.modulus_up_to_bar == pytest.approx(1.5)
    written = robot.read_text(encoding="utf-8")
    assert written.count("calibrated 20") >= 3
    assert "from data.csv" in written
    assert "# Camozzi" in written
    assert figure.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("style", ["block", "elements", "flow"])
def test_command_writes_into_every_style_of_file(style: str, tmp_path: Path, configs: Path) -> None:
    data, robot = tmp_path / "data.csv", tmp_path / "robot.yaml"
    write_csv(data)
    yaml = YAML()
    document = yaml.load((configs / "stiffflop2.yaml").read_text(encoding="utf-8"))
    if style == "elements":
        for each in document["robots"]["arm"]["geometry"]["sections"]:
            each.fa.set_flow_style()
    else:
        plain = YAML(typ="safe", pure=True).load((configs / "stiffflop2.yaml").read_text(encoding="utf-8"))
        yaml.default_flow_style, document = style == "flow", plain
    yaml.dump(document, robot)
    done = CliRunner().invoke(command, ["modulus", str(data), "--write", str(robot)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    arm = load_robot_file(robot).file.robots["arm"]
    assert isinstance(arm, Cosserat)
    first, second = arm.geometry.sections
    assert np.allclose(first.modulus_pa, MODULI[0], atol=2e-3)
    assert np.allclose(second.modulus_pa, MODULI[1], atol=2e-3)


def test_command_prints_json_and_refuses_what_does_not_fit(tmp_path: Path, configs: Path) -> None:
    data = tmp_path / "data.csv"
    write_csv(data)
    done = CliRunner().invoke(command, ["modulus", str(data), "--for", "stiffflop2", "--json"])
    assert done.exit_code == 0, done.output
    first, second = (json.loads(line) for line in done.output.splitlines())
    assert first["grows_to_bar"] is None
    assert second["grows_to_bar"] == pytest.approx(1.996, abs=1e-3)
    with pytest.raises(ContidError, match="the robot has 1"):
        CliRunner().invoke(command, ["modulus", str(data), "--for", "stiffflop1"], catch_exceptions=False)
    text = CliRunner().invoke(command, ["modulus", str(data), "--for", "stiffflop2", "--plot", "fit.txt"])
    assert text.exit_code == 2
    assert "'--plot': 'fit.txt' must end in .png, .svg, .pdf" in text.output
    neither = CliRunner().invoke(command, ["modulus", str(data)])
    assert neither.exit_code == 2
    with pytest.raises(ContidError, match="0 robots of kind pneumatic arm"):
        CliRunner().invoke(command, ["modulus", str(data), "--for", "hand"], catch_exceptions=False)
