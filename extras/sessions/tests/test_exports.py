"""Exports, read by the libraries of their formats; a LeRobot dataset beside the layout that LeRobot writes.

``lerobot-layout.json`` is the layout of a dataset that lerobot 0.4.4 itself wrote: types of all columns,
names of statistics, ``meta/info.json``. That LeRobot loads the export was tried by hand (docs/sessions.md).
"""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from pyarrow import parquet

from contid import Robot, Session, Sim
from tests.support.command import contid, contid_in

pytestmark = pytest.mark.process

LAYOUT = json.loads(Path(__file__).with_name("lerobot-layout.json").read_text())
TIP_MM = (60.0, 75.0)
ROW = {"left.x_mm": TIP_MM[0], "left.y_mm": TIP_MM[1], "right.left_mm": 60.0, "right.right_mm": 61.0}
RACKS = ["measured.left.left_mm", "measured.left.right_mm"]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand whose left finger goes to a point; of more ticks than one block."""
    path = tmp_path_factory.mktemp("exports") / "s.mcap"
    with Sim("hand", record=path) as sim:
        sim.step(ROW, ticks=4500)
    return path


@pytest.fixture(scope="module")
def exported(file: Path) -> Path:
    folder = file.parent
    words = ["--csv", "all.csv", "--parquet", "all.parquet", "--hdf5", "all.h5"]
    done = contid_in(folder, "session", "export", file.name, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["all.csv", "all.parquet", "all.h5"]
    return folder


@pytest.fixture(scope="module")
def table(exported: Path) -> pd.DataFrame:
    with (exported / "all.csv").open() as lines:
        header, *rows = csv.reader(lines)
    return pd.DataFrame([[float(each or "nan") for each in row] for row in rows], columns=header)


def test_measured_tips_are_the_forward_kinematics_of_the_measured_axes(table: pd.DataFrame) -> None:
    racks = table[RACKS].to_numpy()
    known = np.isfinite(racks).all(axis=1)
    assert known.sum() > 4000
    poses = Robot("hand")["left"].fk(racks[known])
    tips = table.loc[known, ["measured.left.x_mm", "measured.left.y_mm"]].to_numpy()
    np.testing.assert_allclose(tips, poses.tip[:, :2], atol=1e-9)
    off = table["measured.left.left_mm"] - table["command.left.left_mm"]
    np.testing.assert_allclose(table["difference.left.left_mm"], off, atol=1e-9)
    # A simulated servo arrives within a step of its encoder.
    np.testing.assert_allclose(tips[-1], TIP_MM, atol=0.05)
    # mm_per_rev and the angles of the devices, by the robot file.
    angle = table["sample.right.left.value_rad"].to_numpy()
    moved = np.ptp(table["measured.right.left_mm"]) / np.ptp(angle)
    assert moved == pytest.approx(37.69911184307752 / (2 * math.pi), rel=1e-9)


def test_parquet_has_the_columns_of_the_csv_with_types(exported: Path, table: pd.DataFrame) -> None:
    found = parquet.read_table(exported / "all.parquet")
    assert found.column_names == [*table.columns]
    assert str(found.schema.field("tick").type) == "int64"
    assert str(found.schema.field("command.left.left_mm").type) == "double"
    assert found["target.left.ax"].null_count == len(table)
    assert found.schema.metadata[b"rate_hz"] == b"200.0"
    assert found.schema.metadata[b"robot_file"].decode() == Session(exported / "s.mcap").robot_text
    frame = found.to_pandas()
    for name in table.columns:
        tolerance = 1e-6 if name == "unix_s" else 0.0
        np.testing.assert_allclose(frame[name], table[name], rtol=0.0, atol=tolerance, err_msg=name)


def test_a_disk_that_gets_full_is_one_message_and_leaves_the_file_that_was_there(file: Path) -> None:
    """h5py printed a traceback for each dataset while it closed."""
    with Sim("finger", record=file.with_name("short.mcap")) as sim:
        for _ in range(300):
            sim.step({"left_mm": 51.0, "right_mm": 51.0})
    out = file.with_name("full.h5")
    out.write_text("the file that was there")
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\n"
        "from contid.entry import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "session", "export", "short.mcap", "--hdf5", out.name],
        cwd=file.parent, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "contid: full.h5: cannot write it: File too large\n"
    assert out.read_text() == "the file that was there"


def test_hdf5_has_a_group_per_channel_and_the_events(exported: Path, table: pd.DataFrame) -> None:
    with h5py.File(exported / "all.h5") as found:
        channels = {"time", "tick", "target", "solution", "command", "sample", "measured", "difference"}
        assert {*found} == {*channels, "event"}
        assert found.attrs["rate_hz"] == 200.0
        np.testing.assert_array_equal(found["command/left.left_mm"][:], table["command.left.left_mm"])
        np.testing.assert_array_equal(found["time/t_s"][:], table["t_s"])
        assert found["tick/left.mode"].dtype == np.int64
        events = [json.loads(line) for line in found["event/json"].asstr()[:]]
    expected = [event.KIND for event in Session(exported / "s.mcap").events()]
    assert [event["event"] for event in events] == expected


@pytest.fixture(scope="module")
def dataset(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two episodes, of the same session."""
    folder = tmp_path_factory.mktemp("lerobot") / "set"
    done = contid("session", "lerobot", str(folder), str(file), str(file), "--task", "go", "--fps", "50")
    assert done.returncode == 0, done.stderr
    assert [*folder.parent.iterdir()] == [folder]
    return folder


def test_a_dataset_has_the_layout_of_lerobot(dataset: Path) -> None:
    for name, columns in LAYOUT["files"].items():
        found = parquet.read_schema(dataset / name)
        assert {each.name: str(each.type) for each in found} == columns, name
    info = json.loads((dataset / "meta" / "info.json").read_text())
    differ = {key for key in info | LAYOUT["info"] if info.get(key) != LAYOUT["info"].get(key)}
    assert differ == {"total_frames", "features"}
    assert info["features"].keys() == LAYOUT["info"]["features"].keys()
    for name, feature in info["features"].items():
        expected = LAYOUT["info"]["features"][name]
        assert (feature["dtype"], feature["shape"]) == (expected["dtype"], expected["shape"])
    assert info["features"]["action"]["names"] == [
        "left.left_mm",
        "left.right_mm",
        "right.left_mm",
        "right.right_mm",
    ]
    statistics = json.loads((dataset / "meta" / "stats.json").read_text())
    assert {key: sorted(each) for key, each in statistics.items()} == LAYOUT["stats"]


def test_a_dataset_has_the_ticks_of_its_sessions(dataset: Path, table: pd.DataFrame) -> None:
    paths = sorted((dataset / "data").glob("*/*.parquet"))
    first, second = (parquet.read_table(path).to_pydict() for path in paths)
    assert second["index"] == [index + len(first["index"]) for index in first["index"]]
    assert second["episode_index"] == [1] * len(first["index"])
    assert first["timestamp"] == pytest.approx([index / 50 for index in first["frame_index"]], abs=1e-5)
    armed = table.dropna(subset=["command.left.left_mm", "command.right.left_mm"])[::4]
    action = np.array(first["action"])
    np.testing.assert_allclose(action[:, 0], armed["command.left.left_mm"], rtol=1e-6)
    np.testing.assert_allclose(
        np.array(first["observation.tip"])[:, 1], armed["measured.left.y_mm"], rtol=1e-6
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("set SESSION --task go --fps 30", "30 frames per second do not divide 200 Hz; allowed: 1, 2, 4"),
        ("taken SESSION --task go", "exists; datasets are never overwritten"),
        ("set SESSION", "Missing option '--task'"),
        ("set SESSION other.mcap --task go", "other axes than"),
    ],
)
def test_what_cannot_be_a_dataset_is_refused(words: str, message: str, file: Path, tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    with Sim("finger", record=tmp_path / "other.mcap") as sim:
        sim.step(ticks=20)
    done = contid_in(tmp_path, "session", "lerobot", *words.replace("SESSION", str(file)).split())
    assert done.returncode != 0
    assert message in done.stderr
    assert not (tmp_path / "set").exists()
    assert not any((tmp_path / "taken").iterdir())
