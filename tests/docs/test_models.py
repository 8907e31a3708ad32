"""The model that docs/models.md adds: its arithmetic, and its package found by the entry point."""

from __future__ import annotations

import json
import math
import os
import random
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from contid.robot_file.positions import read_document
from contid.targets import Target
from contid_vine import MODEL
from contid_vine.model import VineModel

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent
VINE = ROOT / "examples" / "vine"
PAGE = (ROOT / "docs" / "models.md").read_text()


def test_the_page_shows_the_files_of_the_example() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    files = [VINE / "contid_vine" / name for name in ("description.py", "model.py", "__init__.py")]
    assert blocks == [file.read_text() for file in files]
    assert re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL) == [
        (VINE / "vine.yaml").read_text()
    ]


@pytest.fixture(scope="module")
def vine() -> VineModel:
    """The model of the example's robot."""
    document = read_document((VINE / "vine.yaml").read_text(), "vine.yaml").data
    assert isinstance(document, dict)
    robots = document["robots"]
    assert isinstance(robots, dict)
    return MODEL.build(MODEL.description.model_validate_json(json.dumps(robots["vine"]), strict=True))


def reached(vine: VineModel) -> list[tuple[float, ...]]:
    """Actuations from all over the range, the straight line included."""
    chance = random.Random(7)
    some = [
        tuple(chance.uniform(low, high) for low, high in zip(vine.lower, vine.upper, strict=True))
        for _ in range(200)
    ]
    return [*some, (0.1, 0.0), (0.1, 1e-12), (0.1, -1e-7)]


def test_the_inverse_undoes_the_forward(vine: VineModel) -> None:
    for actuation in reached(vine):
        solution = vine.inverse(Target(tip_m=vine.forward(actuation).tip_m), vine.lower)
        assert solution.converged
        assert solution.actuation == pytest.approx(actuation, abs=1e-12)


def test_the_jacobian_is_the_derivative(vine: VineModel) -> None:
    step = 1e-6
    for feed, pull in reached(vine):
        found = vine.jacobian((feed, pull))
        columns = [
            np.subtract(vine.forward(above).tip_m, vine.forward(below).tip_m) / (2 * step)
            for above, below in (
                ((feed + step, pull), (feed - step, pull)),
                ((feed, pull + step), (feed, pull - step)),
            )
        ]
        assert found == pytest.approx(np.array(columns).T, abs=1e-6)


def test_out_of_reach_is_an_answer_inside_the_limits(vine: VineModel) -> None:
    solution = vine.inverse(Target(tip_m=(0.0, 0.5, 0.0)), vine.lower)
    assert not solution.converged
    assert solution.limited_by == ("feed.max",)
    assert solution.residual_m == pytest.approx(0.2)
    assert vine.inverse(Target(actuation=(9.0, 0.0)), vine.lower).actuation == (vine.upper[0], 0.0)


def test_the_shape_ends_at_the_tip_and_has_the_length_that_was_fed(vine: VineModel) -> None:
    for feed, pull in reached(vine):
        line = vine.shape((feed, pull), 400)
        assert line[-1] == pytest.approx(vine.forward((feed, pull)).tip_m)
        assert sum(map(math.dist, line[:-1], line[1:])) == pytest.approx(feed, rel=1e-4)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the robot file and what ``pip install`` leaves of the example."""
    (tmp_path / "vine.yaml").write_text((VINE / "vine.yaml").read_text())
    metadata = tmp_path / "site" / "contid_vine-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: contid-vine\nVersion: 1.0\n")
    packaging = (VINE / "pyproject.toml").read_text()
    points = re.search(r'entry-points\."(contid\.models)"\]\n(\w+) = "(.*)"', packaging)
    assert points
    (metadata / "entry_points.txt").write_text(f"[{points[1]}]\n{points[2]} = {points[3]}\n")
    return tmp_path


def python(folder: Path, *arguments: str, rows: str = "", code: int = 0) -> str:
    path = [folder / "site", VINE, ROOT, ROOT / "drivers"]
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path)), "XDG_RUNTIME_DIR": str(folder)},
        input=rows,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr if code else done.stdout


def contid(folder: Path, *arguments: str, rows: str = "", code: int = 0) -> str:
    return python(folder, "-m", "contid", *arguments, rows=rows, code=code)


def test_the_commands_and_the_library_find_the_installed_model(folder: Path) -> None:
    report = json.loads(contid(folder, "check", "--json", "vine.yaml"))
    assert report["robots"][0]["model"] == "vine"
    actuation = "feed_mm,pull_mm\n100.0,6.0\n200.0,-12.0\n"
    tips = contid(folder, "fk", "vine.yaml", rows=actuation)
    back = contid(folder, "ik", "vine.yaml", "--bare", rows=tips)
    found = [[float(cell) for cell in line.split(",")] for line in back.splitlines()[1:]]
    assert np.allclose(found, [[100.0, 6.0], [200.0, -12.0]])
    script = (
        "from contid import Robot, Sim\n"
        "robot = Robot('vine.yaml'); answer = robot.ik([[30, 100], [0, 500]])\n"
        "print(answer.converged.tolist(), robot.limits_in(answer.limited_by[1]))\n"
        "with Sim('vine.yaml') as sim: print(sim.step([160, 0], ticks=400)['vine'].command.tolist())\n"
    )
    assert python(folder, "-c", script) == "[True, False] ('feed.max',)\n[160.0, 0.0]\n"
    schema = json.loads(contid(folder, "schema"))
    mapping = schema["properties"]["robots"]["additionalProperties"]["discriminator"]["mapping"]
    assert schema["$defs"][mapping["vine"].rpartition("/")[2]]["properties"]["limits"]
    assert "vine" not in contid(folder, "schema", "--markdown")


@pytest.mark.realtime
def test_a_run_in_its_own_process_is_recorded_and_replays(folder: Path) -> None:
    rows = "t_s,x_mm,y_mm\n0,0,160\n1,20,160\n2,0,170\n"
    contid(folder, "run", "vine.yaml", "--mock", "--record", "run.mcap", rows=rows)
    assert "bit for bit" in contid(folder, "replay", "run.mcap")


def test_mistakes_in_its_keys_are_named_with_their_place(folder: Path) -> None:
    text = (folder / "vine.yaml").read_text()
    (folder / "bad.yaml").write_text(text.replace("tendon_mm: 12", "tendn_mm: 12"))
    report = contid(folder, "check", "bad.yaml", code=2)
    assert re.search(r"bad\.yaml:9:\d+: .*'tendn_mm'.*did you mean 'tendon_mm'", report)
    (folder / "name.yaml").write_text(text.replace("model: vine", "model: vin"))
    assert "chain, vine; did you mean 'vine'?" in contid(folder, "check", "name.yaml", code=2)


def test_a_package_that_cannot_be_used_is_named(folder: Path) -> None:
    points = folder / "site" / "contid_vine-1.0.dist-info" / "entry_points.txt"
    points.write_text("[contid.models]\nvine = contid_vine:NOTHING\n")
    report = contid(folder, "check", "vine.yaml", code=2)
    assert "vine.yaml:8:12: model 'vine' (contid-vine: contid_vine:NOTHING) cannot be imported" in report
    points.write_text("[contid.models]\nvines = contid_vine:MODEL\n")
    (folder / "vine.yaml").write_text(
        (folder / "vine.yaml").read_text().replace("model: vine", "model: vines")
    )
    report = contid(folder, "check", "vine.yaml", code=2)
    assert "its description has model: Literal['vine'], not 'vines'" in report
    points.unlink()
    assert "model: 'vines' is not possible; allowed: " in contid(folder, "check", "vine.yaml", code=2)
