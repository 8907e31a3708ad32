"""What the viewer of a daemon draws: the entities of its layout exist, and show the run."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun.blueprint as rrb

from contid.robot_file.load import load_robot_file
from contid_view.layout import FIELD_OF_VIEW, build_layout, camera
from contid_view.scene import MAX_CELLS, build_scene, rope_line
from tests.support.command import contid
from tests.support.rerun_entities import entities
from tests.support.viewed_runs import PATHS, drawn, rows_of

pytestmark = pytest.mark.process


def shown(part: Any) -> Iterator[str]:
    """Entities that a layout, or a part of one, shows."""
    if isinstance(part, rrb.Blueprint):
        yield from shown(part.root_container)
    elif isinstance(part, rrb.Container):
        for child in part.contents:
            yield from shown(child)
    else:
        for expression in part.contents:
            yield expression.removeprefix("+ /")


@pytest.mark.parametrize("robot", PATHS)
def test_every_entity_of_the_layout_is_in_the_file(robot: str, tmp_path: Path, configs: Path) -> None:
    recording = drawn(robot, tmp_path)
    loaded = load_robot_file(configs / f"{robot}.yaml")
    scene = build_scene(loaded, loaded.file.rate_hz)
    in_layout = set(shown(build_layout(scene, live=True, finished=True)))
    assert len(in_layout) > 8
    there = entities(recording)
    assert in_layout <= set(there)
    for robot_name in (each.config.name for each in scene.robots):
        assert there[f"robots/{robot_name}/backbone"] >= 30  # frames of one second
        assert there[f"plots/{robot_name}/tip_error"] >= 30
        assert there[f"plots/{robot_name}/tip_error_measured"] >= 30
    for rope in scene.ropes:
        assert there[f"robots/{rope.name}/rope"] >= 30


@pytest.mark.parametrize("robot", PATHS)
def test_the_camera_shows_the_whole_workspace(robot: str, configs: Path) -> None:
    """At any size of a robot its workspace is inside the view and fills it."""
    loaded = load_robot_file(configs / f"{robot}.yaml")
    scene = build_scene(loaded, loaded.file.rate_hz)
    position, look_target, up = camera(scene)
    ahead = (look_target - position) / np.linalg.norm(look_target - position)
    right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
    across, upwards = right, np.cross(right, ahead)
    points = scene.workspace() - position
    depth = points @ ahead
    assert np.min(depth) > 0.0
    filled = [2.0 * np.abs(points @ axis / depth).max() for axis in (across, upwards)]
    assert np.all(filled <= FIELD_OF_VIEW + 1e-9)
    assert np.any(filled >= FIELD_OF_VIEW - 1e-9)
    floor = np.vstack(scene.floor())
    assert np.all(floor[:, 2] == 0.0)
    assert len(scene.floor()) <= 2 * (MAX_CELLS + 3)


def test_a_rope_hangs_between_its_tips_and_is_missing_when_one_is_unknown(configs: Path) -> None:
    scene = build_scene(load_robot_file(configs / "chain.yaml"), 100.0)
    drawings = {robot.config.name: robot.drawing(robot.config.rest) for robot in scene.robots}
    (rope,) = scene.ropes
    line = rope_line(rope, drawings)
    assert line is not None
    tips = [drawing.tip for drawing in map(drawings.get, rope.arms) if drawing is not None]
    assert np.allclose(line[[0, -1]], tips, atol=1e-6)
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(1000.0, rel=2e-3)
    assert np.min(line[:, 2]) < min(tip[2] for tip in tips) - 100.0
    assert rope_line(rope, {**drawings, rope.arms[1]: None}) is None


def test_a_measured_tip_and_the_curve_to_it_are_drawn_beside_the_model(tmp_path: Path) -> None:
    rows = [row.split(",") for row in rows_of("stiffflop2", "--rate", "50").splitlines() if row[0] != "#"]
    head, *numbers = rows
    assert head == ["t_s", "x_mm", "y_mm", "z_mm"]
    measured = [f"meas.{name}" for name in (*head[1:], "ax", "ay", "az")]
    lines = [",".join([*head, *measured])]
    lines += [
        ",".join([*row, *row[1:], *(("0", "0", "1") if float(row[0]) < 0.5 else ("0",) * 3)])
        for row in numbers
    ]
    session, rrd, folder = tmp_path / "run.mcap", tmp_path / "run.rrd", tmp_path / "csv"
    recorded = contid("run", "stiffflop2", "--virtual", "--record", str(session), stdin="\n".join(lines))
    assert recorded.returncode == 0, recorded.stderr
    assert contid("session", "export", str(session), "--rrd", str(rrd)).returncode == 0
    there = entities(rrd)
    # Every frame has the tip; half of them the curve, where the tracker measured a direction.
    assert there["robots/arm/tracked_tip"] >= 30
    assert 10 <= there["robots/arm/tracked"] <= there["robots/arm/tracked_tip"] - 10
    assert contid("session", "export", str(session), "--csv", str(folder)).returncode == 0
    with (folder / "sample.csv").open(newline="") as file:
        samples = [row for row in csv.DictReader(file) if row["arm.meas.x_mm"]]
    assert float(samples[0]["arm.meas.x_mm"]) == pytest.approx(float(numbers[0][1]))
    assert {row["arm.meas.az"] for row in samples} == {"1.0", ""}
    replayed = contid("replay", str(session))
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr


@pytest.mark.realtime
def test_the_drawing_of_a_real_run_has_its_events_and_some_thirty_frames_a_second(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.rrd"
    done = contid("run", "hand", "--mock", "--view", str(path), stdin=rows_of("hand"))
    assert done.returncode == 0, done.stderr
    assert "viewer" not in done.stdout
    there = entities(path)
    assert there["events"] >= 4
    assert 30 <= there["plots/timing"] <= 30 * 10


def test_a_recorded_session_keeps_every_tick_in_its_curves(tmp_path: Path) -> None:
    session, rrd = tmp_path / "run.mcap", tmp_path / "run.rrd"
    assert contid("run", "hand", "--virtual", "--record", str(session), stdin=rows_of("hand")).returncode == 0
    assert contid("session", "export", str(session), "--rrd", str(rrd)).returncode == 0
    ticks = json.loads(contid("session", "info", "--json", str(session)).stdout)["ticks"]
    there = entities(rrd)
    assert there["plots/timing"] == ticks + 1  # and the names of the curves
    assert there["robots/left/backbone"] <= ticks * 30 / 200 + 2


def test_the_export_for_foxglove_needs_no_scipy() -> None:
    """It is not in the extra of the export."""
    code = "import sys; sys.modules['scipy'] = None; import contid_view.foxglove_export"
    subprocess.run([sys.executable, "-c", code], check=True)
