"""The export for Foxglove, read by the library of its format beside the exported table."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from scipy.spatial.transform import Rotation

from contid import Robot, Sim
from contid_sessions.group import command as session
from contid_view.foxglove_export import quaternion

pytestmark = pytest.mark.process

TIP_MM = (60.0, 75.0)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand whose left finger goes to a point."""
    path = tmp_path_factory.mktemp("exports") / "s.mcap"
    with Sim("hand", record=path) as sim:
        for _ in range(900):
            sim.step(
                {"left.x_mm": TIP_MM[0], "left.y_mm": TIP_MM[1], "right.left_mm": 60, "right.right_mm": 61}
            )
    return path


@pytest.fixture(scope="module")
def exported(file: Path) -> Path:
    """In this process, where the ticks of the session are more than a block; see `contid_sessions.table`."""
    folder = file.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("contid_sessions.table._BLOCK", 800)
        patch.chdir(folder)
        done = CliRunner().invoke(
            session, ["export", file.name, "--csv", "all.csv", "--foxglove", "fox.mcap"]
        )
    assert done.exit_code == 0, done.output
    assert done.stdout.split() == ["all.csv", "fox.mcap"]
    return folder


@pytest.fixture(scope="module")
def table(exported: Path) -> pd.DataFrame:
    with (exported / "all.csv").open() as lines:
        return pd.DataFrame(csv.DictReader(lines)).replace("", "nan").astype(float)


def test_foxglove_messages_have_the_robot_where_it_is(exported: Path, table: pd.DataFrame) -> None:
    last: dict[str, Any] = {}
    counts: dict[str, int] = {}
    with (exported / "fox.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            assert schema.name.startswith("foxglove.")
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            last[channel.topic] = decoded
            final_ns = message.log_time
    assert counts["/joint_states"] == len(table)
    assert counts["/scene"] == counts["/tf"] == math.ceil(len(table) / 200 * 30)
    assert final_ns == pytest.approx(table["unix_s"].iloc[-1] * 1e9, abs=5e4)
    joints = {joint.name: joint.position for joint in last["/joint_states"].joints}
    assert joints["left/left"] == pytest.approx(table["measured.left.left_mm"].iloc[-1] / 1e3, rel=1e-12)
    frames = {each.child_frame_id: each for each in last["/tf"].transforms}
    assert {*frames} == {"left", "left/tip", "right", "right/tip"}
    tip = frames["left/tip"].translation
    assert (1e3 * tip.x, 1e3 * tip.y) == pytest.approx(TIP_MM, abs=0.1)
    # The y axis of the tip frame is the tangent of the finger.
    for name in ("left", "right"):
        racks = table[[f"measured.{name}.left_mm", f"measured.{name}.right_mm"]].to_numpy()[-1:]
        q = frames[f"{name}/tip"].rotation
        along = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()[:, 1]
        assert along[:2] == pytest.approx(Robot("hand")[name].fk(racks).direction[0, :2], abs=2e-3)
    bodies = {entity.id: entity for entity in last["/scene"].entities}
    assert len(bodies["left"].cylinders) > 30
    ends = []
    for part in bodies["left"].cylinders:
        middle, q = part.pose.position, part.pose.orientation
        along = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply([0.0, 0.0, 0.5 * part.size.z])
        ends.append([middle.x + along[0], middle.y + along[1], middle.z + along[2]])
    # The tip body ends at the tip.
    assert np.linalg.norm(np.array(ends) - [tip.x, tip.y, tip.z], axis=1).min() < 1e-6
    assert bodies["left"].lines[-1].points[-1].x == pytest.approx(tip.x, abs=2e-3)
    assert 1e3 * bodies["left"].spheres[0].pose.position.x == pytest.approx(TIP_MM[0])


@pytest.mark.parametrize("axes", [(1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, -1.0)])
def test_foxglove_frames_of_mirrored_robots_keep_their_x_and_y(axes: tuple[float, float, float]) -> None:
    """A robot's mirror leaves a left-handed frame, which no quaternion has; oracle: scipy's rotations."""
    for turn in Rotation.random(50, random_state=5).as_matrix():
        frame = np.vstack([[[100.0, 200.0, 300.0]], np.diag(axes) @ turn])
        matrix = Rotation.from_quat(quaternion(frame)).as_matrix()
        np.testing.assert_allclose(matrix[:, :2].T, frame[1:3], atol=1e-12)
