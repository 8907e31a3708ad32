"""contid calibrate tendon, as printed in the docs, on an excerpt of a real recording."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from ruamel.yaml import YAML

from contid.errors import ContidError
from contid.robot_file.load import load_named, load_robot_file
from contid.robot_file.tendon.robot import TendonRobot
from contid_fit.calibrate.tendon import fit_robot
from contid_fit.calibrate.tendon.fit_robot import calibrate
from contid_fit.calibrate.tendon.models import Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording
from contid_fit.calibrate.tendon.stages import Stage, run_stages
from contid_fit.commands import command
from contid_fit.commands.tendon_session import session_recording
from tests.calibrate.tendon_recordings import excerpt, excerpt_lines

pytestmark = pytest.mark.process

CONFIG = Path(__file__).parents[4] / "configs" / "ftdcr_v4.yaml"


@pytest.fixture(scope="module", autouse=True)
def fonts() -> None:
    """Matplotlib never closes its font files; open them before descriptors are counted."""
    from matplotlib.figure import Figure

    Figure().savefig(BytesIO())
    figure = Figure()
    figure.text(0.0, 0.0, "x")
    figure.savefig(BytesIO())


@pytest.fixture(scope="module")
def thinned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every second row of pulls of one tendon and two patterns of each section."""
    path = tmp_path_factory.mktemp("data") / "pulls.csv"
    head, *rows = (line for line in excerpt_lines() if "pair" not in line and "dir240" not in line)
    path.write_text("\n".join([head, *rows[::2]]) + "\n", encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def fitted_once() -> Iterator[None]:
    """The stages of the same rows and geometry are fitted once: they do not depend on the rest of a file."""
    made: dict[bytes, tuple[Stage, ...]] = {}

    def stages(
        training: TendonRecording, held_out: TendonRecording | None, nominal: Nominal
    ) -> tuple[Stage, ...]:
        rows = [part for each in (training, held_out) if each for part in (each.pull_m, each.tip_m)]
        key = b"".join(part.tobytes() for part in rows) + repr(nominal).encode()
        if key not in made:
            made[key] = tuple(run_stages(training, held_out, nominal))
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit_robot, "run_stages", stages)
        yield


@pytest.mark.slow
@pytest.mark.usefixtures("fitted_once")
def test_the_fit_is_written_back_with_its_origin(thinned: Path, tmp_path: Path) -> None:
    robot_file, figure = tmp_path / "arm.yaml", tmp_path / "fit.png"
    written = CONFIG.read_text(encoding="utf-8")
    robot_file.write_text(
        written.replace("    rates:\n", "    friction:\n      play_mm: [0.5]\n    rates:\n"), encoding="utf-8"
    )
    arguments = ["tendon", str(thinned), "--write", str(robot_file), "--json", "--plot", str(figure)]
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["stages"][0]["name"] == "constant curvature"
    stages = {stage["name"]: stage for stage in found["stages"]}
    statics = stages["+ friction, play"]
    assert statics["train"]["rmse_mm"] < 4.0
    off_mm = {name: stage["held_out"]["rmse_mm"] for name, stage in stages.items()}
    assert off_mm["+ friction, play"] < 0.6 * off_mm["constant curvature"]
    assert statics["held_out"]["rows"] == round(
        0.2 * (statics["held_out"]["rows"] + statics["train"]["rows"])
    )
    assert figure.stat().st_size > 10_000

    text = robot_file.read_text(encoding="utf-8")
    robot = load_robot_file(robot_file).file.robots["arm"]
    assert isinstance(robot, TendonRobot)
    assert text.count("calibrated 20") == 6
    assert robot.capstan is not None
    assert robot.capstan[0] == pytest.approx(found["capstan"]["value"], abs=1e-4)
    assert found["capstan"]["low"] < robot.capstan[0] < found["capstan"]["high"]
    assert robot.friction is not None
    assert len(robot.friction.play_mm) == 3
    assert robot.friction.play_mm[0] < 0.2
    assert "# Tendons stay on their spools" in text
    assert "geometry.sections" not in robot.placeholder
    radii = found["parameters"]["radius_mm"]
    assert robot.geometry.sections[1].radius_mm[0] == pytest.approx(radii["s2.t1"]["value"], abs=1e-4)
    assert radii["s2.t1"]["low"] < radii["s2.t1"]["value"] < radii["s2.t1"]["high"]
    # The servos that the authors' labels print for tendons 0, 1, 2 of the first section.
    axes = YAML(typ="safe").load(text)["robots"]["arm"]["axes"]
    assert [axes[f"s1.t{i}"]["id"] for i in (1, 2, 3)] == [4, 3, 9]
    # Bending stiffness over stiffness of a tendon is what was measured.
    assert robot.tension is not None
    ratio = robot.tension.bending_n_mm2[0] / (
        robot.tension.tendon_n_per_mm[0] * robot.geometry.sections[0].length_mm
    )
    assert ratio == pytest.approx(found["parameters"]["stiffness_mm2"]["s1"]["value"], rel=1e-3)
    assert math.isfinite(ratio)


@pytest.mark.process
def test_a_session_with_measured_tips_is_read(tmp_path: Path) -> None:
    """A real run follows pulls; the tips of its tracker come from the same file."""
    axes = [f"s{s}.t{t}" for s in (1, 2, 3) for t in (1, 2, 3)]
    rows = ["t_s," + ",".join(f"{axis}_mm" for axis in axes) + ",meas.x_mm,meas.y_mm,meas.z_mm"]
    for k in range(241):
        t = 0.05 * k
        bend = 1.2 * math.sin(0.5 * t)
        pull = [
            bend * math.cos(2.0 * math.pi / 3.0 * i + 0.3 * (i // 3)) + 0.4 * min(1.0, t) for i in range(9)
        ]
        rows.append(",".join(f"{each:.4f}" for each in (t, *pull, 20.0 * bend, 0.01 * k, 180.0 - bend**2)))
    trajectory, session = tmp_path / "pulls.csv", tmp_path / "pulls.mcap"
    trajectory.write_text("\n".join(rows) + "\n", encoding="utf-8")
    contid = [sys.executable, "-m", "contid"]
    ran = subprocess.run(
        [*contid, "run", "tendon3", "--mock", "--virtual", "--trajectory", trajectory, "--record", session],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    recording = session_recording(session, "arm")
    assert recording.servos == tuple(axes)
    # The tracker's tip is that of the rows of the trajectory; x follows the first tendon's pull.
    moving = recording.pull_m.mean(axis=1) > 0.3999e-3  # after the first second
    bend_mm = 1e3 * recording.pull_m[moving, 0] - 0.4
    assert np.abs(1e3 * recording.tip_m[moving, 0] - 20.0 * bend_mm).max() < 1.5
    with pytest.raises(ContidError, match="no robot 'leg'; the session has arm"):
        session_recording(session, "leg")
    result = CliRunner().invoke(command, ["tendon", str(session), "--for", "tendon3"])
    assert result.exit_code == 0, result.output
    assert "no tendon is pulled alone: columns are taken in the order of the axes" in result.stdout


def test_another_robot_s_data_are_refused(tmp_path: Path) -> None:
    header = "timestamp,pattern_label,servo_1_mm,servo_2_mm,servo_3_mm,tip_x,tip_y,tip_z\n"
    data = tmp_path / "other.csv"
    data.write_text(header + "0,a,0,0,0,1,2,3\n", encoding="utf-8")
    result = CliRunner().invoke(command, ["tendon", str(data), "--for", "ftdcr_v4"])
    assert result.exit_code != 0
    assert "3 servos, the robot has 9 tendons" in str(result.exception)
    result = CliRunner().invoke(command, ["tendon", str(data), "--for", "stiffflop2"])
    assert "tendon robot" in str(result.exception)
    assert isinstance(load_named("ftdcr_v4").file.robots["arm"], TendonRobot)


def test_other_servos_in_the_rows_kept_out_are_refused(tmp_path: Path) -> None:
    """Also for tendons in sheaths, whose places are not looked for."""
    robot = load_named("ftdcr_v4").file.robots["arm"]
    assert isinstance(robot, TendonRobot)
    sheaths = robot.model_copy(
        update={"geometry": robot.geometry.model_copy(update={"routing": "independent"})}
    )
    recording = excerpt()
    for kept in (robot, sheaths):
        with pytest.raises(ContidError, match="3 servos, the robot has 9 tendons"):
            calibrate(kept, recording, recording.in_order([0, 1, 2]), 0.0)
    with pytest.raises(ContidError, match="3 servos, the robot has 9 tendons"):
        calibrate(sheaths, recording.in_order([0, 1, 2]), None, 0.2)


def test_too_few_rows_are_refused(tmp_path: Path) -> None:
    short = tmp_path / "short.csv"
    head, *rows = excerpt_lines()
    short.write_text("\n".join([head, *rows[-30:]]) + "\n", encoding="utf-8")
    result = CliRunner().invoke(command, ["tendon", str(short), "--for", "ftdcr_v4"])
    assert "24 rows to fit; give 40 or more" in str(result.exception)


@pytest.mark.parametrize(
    ("kind", "robot"), [("tendon", "ftdcr_v4"), ("modulus", "stiffflop2"), ("curvature", "finger")]
)
def test_a_file_that_is_no_text_is_refused_without_a_traceback(kind: str, robot: str, tmp_path: Path) -> None:
    image = tmp_path / "scan.csv"
    image.write_bytes(b"\x89PNG\r\n")
    result = CliRunner().invoke(command, [kind, str(image), "--for", robot])
    assert isinstance(result.exception, ContidError)
    assert "scan.csv: not a table in UTF-8 text" in str(result.exception)


def test_rows_kept_out_that_are_no_text_are_named(tmp_path: Path) -> None:
    data, image = tmp_path / "pulls.csv", tmp_path / "scan.csv"
    data.write_text("\n".join(excerpt_lines()) + "\n", encoding="utf-8")
    image.write_bytes(b"\x89PNG\r\n")
    arguments = ["tendon", str(data), "--for", "ftdcr_v4", "--held-out", str(image)]
    result = CliRunner().invoke(command, arguments)
    assert "scan.csv: not a table in UTF-8 text" in str(result.exception)


@pytest.mark.usefixtures("fitted_once")
def test_friction_is_added_to_a_file_without_it_where_it_predicts_better(
    thinned: Path, tmp_path: Path
) -> None:
    robot_file = tmp_path / "arm.yaml"
    robot_file.write_text(CONFIG.read_text(encoding="utf-8"), encoding="utf-8")
    result = CliRunner().invoke(command, ["tendon", str(thinned), "--write", str(robot_file)])
    assert result.exit_code == 0, result.output
    better = "friction does not predict" not in result.output
    robot = load_robot_file(robot_file).file.robots["arm"]
    assert isinstance(robot, TendonRobot)
    assert (robot.friction is not None) is better
    assert "capstan coefficient of the friction" in result.output
    if better:
        assert robot.capstan is not None
        assert "capstan" in robot_file.read_text(encoding="utf-8").split("friction:")[1].split("rates:")[0]
