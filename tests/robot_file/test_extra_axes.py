"""Axes beyond the kinematics: any robot may have them, in the unit of its own axes or in degrees."""

from __future__ import annotations

import csv
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.remote.client.described_robot import columns_of
from contid.remote.server.telemetry_view import TelemetryView
from contid.robot_file.load import load_robot_file
from tests.support.command import contid_in

pytestmark = pytest.mark.process

#: Robot file -> the extra axis as it is written, and what its device has beyond that of the first axis.
ROBOTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "finger": ({"extra_mm": {"wrist": [-20, 20]}}, {"id": 7}),
    "trirack": ({"extra_mm": {"grip": [0, 60]}}, {"channel": "m3"}),
    "tendon3": ({"extra_mm": {"grip": [0, 30]}}, {"id": 40}),
    "stiffflop1": ({"extra_bar": {"grip": [0, 1]}}, {"channel": "p3"}),
}
#: In degrees, with a bus of servos where the robot has none.
SERVOS = {"driver": "dynamixel", "port": "/dev/none", "baud": 1000000, "tolerance_ticks": 10}
TURNS = {"velocity_deg_s": 180, "acceleration_deg_s2": 3000, "jerk_deg_s3": 60000}


def with_extra(configs: Path, folder: Path, name: str, **change: object) -> Path:
    """A copy of a shipped file whose robot has one extra axis more."""
    keys, device = ROBOTS[name]
    document = yaml.safe_load((configs / f"{name}.yaml").read_text())
    (robot,) = document["robots"].values()
    first = next(iter(robot["axes"].values()))
    robot["axes"] |= {axis: {**first, **device} for axis in next(iter(keys.values()))}
    robot |= change or keys
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


#: One robot of each quantity; others differ in nothing that is tested here.
QUANTITIES = [
    "finger",
    "stiffflop1",
    *(pytest.param(each, marks=pytest.mark.campaign) for each in ("trirack", "tendon3")),
]


@pytest.mark.parametrize("name", ["stiffflop1", pytest.param("finger", marks=pytest.mark.campaign)])
def test_it_is_driven_beside_the_model(name: str, tmp_path: Path, configs: Path) -> None:
    ((name_of, robot),) = load_robot_file(with_extra(configs, tmp_path, name)).file.robots.items()
    axis, unit = robot.extra_axis_names[0], robot.quantity.unit
    low, high = (robot.quantity.from_si(end) for end in robot.extra_limits[axis])
    columns = [f"{each}_{unit}" for each in robot.all_axis_names]
    rest = [robot.quantity.from_si(each) for each in robot.rest]

    def run(end: float) -> subprocess.CompletedProcess[str]:
        rows = [(0.0, *rest, low), (5.0, *rest, end)]
        text = "\n".join([",".join(["t_s", *columns]), *(",".join(map(repr, row)) for row in rows)])
        return contid_in(tmp_path, "run", f"{name}.yaml", "--virtual", "--log", "log.csv", stdin=text)

    done = run(high)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "log.csv").open() as file:
        commands = [
            float(row[f"{name_of}.{axis}.command"])
            for row in csv.DictReader(file)
            if row[f"{name_of}.{axis}.command"]
        ]
    assert max(commands) == pytest.approx(robot.quantity.to_si(high), rel=1e-6)
    refused = run(high + 0.5)
    assert refused.returncode == 2
    assert f": {axis} " in refused.stderr
    assert "beyond its limit of" in refused.stderr


@pytest.mark.parametrize(
    ("name", "key", "axes", "message"),
    [
        ("finger", "extra_bar", {"grip": [0, 1]}, "extra_bar has no meaning here"),
        ("stiffflop1", "extra_mm", {"grip": [0, 1]}, "extra_mm has no meaning here"),
        ("finger", "extra_mm", {"left": [0, 1]}, "'left' is an axis of the model"),
        ("finger", "extra_mm", {"x": [0, 1]}, "'x' is a coordinate of the tip"),
        ("finger", "extra_mm", {"meas.x": [0, 1]}, "allowed are letters, digits and _"),
        ("finger", "extra_mm", {"wrist": [1, 0]}, "wrist: the first number must be less"),
    ],
)
def test_a_wrong_one_is_refused_where_it_stands(
    name: str, key: str, axes: dict[str, object], message: str, tmp_path: Path, configs: Path
) -> None:
    path = with_extra(configs, tmp_path, name, **{key: axes})
    done = contid_in(tmp_path, "check", path.name)
    assert done.returncode != 0
    found = re.search(rf"{name}.yaml:(\d+):\d+: .*{re.escape(message)}", done.stdout + done.stderr)
    assert found, done.stdout + done.stderr
    number = int(found[1])
    near = "\n".join(path.read_text().splitlines()[number - 2 : number])
    assert any(text in near for text in (key, *axes))


def test_a_chain_has_none(tmp_path: Path, configs: Path) -> None:
    document = yaml.safe_load((configs / "chain.yaml").read_text())
    document["robots"]["rope"]["extra_mm"] = {"grip": [0, 1]}
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(document))
    done = contid_in(tmp_path, "check", "chain.yaml")
    assert "extra_mm has no meaning here: 'rope' has no actuators of its own" in done.stdout + done.stderr


def with_wrist(configs: Path, folder: Path, name: str, **change: object) -> Path:
    """A copy of a shipped file whose robot turns a wrist in degrees."""
    document = yaml.safe_load((configs / f"{name}.yaml").read_text())
    (robot,) = document["robots"].values()
    document["buses"]["wrists"] = SERVOS
    robot["axes"]["wrist"] = {"bus": "wrists", "id": 77, "zero_deg": 30, "direction": -1}
    robot["rates"] |= TURNS
    robot |= {"extra_deg": {"wrist": [-90, 45]}, **change}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@pytest.mark.parametrize("name", ["finger", pytest.param("stiffflop1", marks=pytest.mark.campaign)])
def test_a_wrist_turns_in_degrees_beside_any_model(name: str, tmp_path: Path, configs: Path) -> None:
    """From the column to the device, exports and a replay; oracle: the angle of the servo."""
    ((name_of, robot),) = load_robot_file(with_wrist(configs, tmp_path, name)).file.robots.items()
    assert robot.columns[-1] == "wrist_deg"
    rest = [quantity.from_si(each) for quantity, each in zip(robot.quantities, robot.rest, strict=False)]

    def run(end: float, *more: str) -> subprocess.CompletedProcess[str]:
        rows = [(0.0, *rest, -80.0), (3.0, *rest, end)]
        text = "\n".join([",".join(["t_s", *robot.columns]), *(",".join(map(repr, row)) for row in rows)])
        return contid_in(tmp_path, "run", f"{name}.yaml", "--virtual", *more, stdin=text)

    done = run(40.0, "--log", "log.csv", "--record", "s.mcap")
    assert done.returncode == 0, done.stderr
    with (tmp_path / "log.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row[f"{name_of}.wrist.command"]]
    commands = np.array([float(row[f"{name_of}.wrist.command"]) for row in rows])
    assert np.degrees(commands[-1]) == pytest.approx(40.0, abs=1e-2)
    most = np.radians(180.0) / robot_rate(tmp_path / f"{name}.yaml")
    assert np.abs(np.diff(commands)).max() <= most * (1.0 + 1e-9)

    exported = contid_in(tmp_path, "session", "export", "s.mcap", "--csv", "csv")
    assert exported.returncode == 0, exported.stderr
    with (tmp_path / "csv" / "command.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    assert float(last[f"{name_of}.wrist_deg"]) == pytest.approx(40.0, abs=1e-2)
    # The servo turns the other way, from 30 degrees.
    device = float(last[f"{name_of}.device.wrist_rad"])
    assert np.degrees(device) == pytest.approx(30.0 - 40.0, abs=1e-2)
    replayed = contid_in(tmp_path, "replay", "s.mcap")
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr

    refused = run(60.0)
    assert refused.returncode == 2
    assert ": wrist " in refused.stderr
    assert "beyond its limit of" in refused.stderr
    fast = contid_in(
        tmp_path, "run", f"{name}.yaml", "--virtual",
        stdin="\n".join(
            [",".join(["t_s", *robot.columns])]
            + [",".join(map(repr, (k / 10, *rest, -80.0 + 40.0 * k))) for k in range(4)]
        ),
    )  # fmt: skip
    assert fast.returncode == 2
    assert "deg/s, limit 180" in fast.stderr


def robot_rate(path: Path) -> float:
    return float(yaml.safe_load(path.read_text())["rate_hz"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extra_mm": {"wrist": [0, 1]}}, "extra_deg: 'wrist' is in extra_mm too"),
        ({"extra_deg": {"left": [0, 1]}}, "extra_deg: 'left' is an axis of the model"),
        ({"extra_deg": {"x": [0, 1]}}, "'x' is a coordinate of the tip"),
        ({"extra_deg": {"a.b": [0, 1]}}, "allowed are letters, digits and _"),
        ({"rates": {"velocity_mm_s": 60, "acceleration_mm_s2": 1000, "jerk_mm_s3": 20000}},
         "key 'velocity_deg_s' is missing; wrist of extra_deg needs it"),
        ({"extra_deg": {}}, "velocity_deg_s has no meaning here: this robot has no extra_deg"),
    ],
)  # fmt: skip
def test_a_wrong_angle_is_refused_where_it_stands(
    change: dict[str, object], message: str, tmp_path: Path, configs: Path
) -> None:
    path = with_wrist(configs, tmp_path, "finger", **change)
    done = contid_in(tmp_path, "check", path.name)
    assert done.returncode != 0
    assert re.search(rf"finger.yaml:(\d+):\d+: .*{re.escape(message)}", done.stdout + done.stderr), (
        done.stderr
    )


def test_a_wrist_has_no_pinion_and_no_regulator(tmp_path: Path, configs: Path) -> None:
    path = with_wrist(configs, tmp_path, "finger")
    text = path.read_text().replace("zero_deg: 30", "mm_per_rev: 30")
    path.write_text(text)
    done = contid_in(tmp_path, "check", path.name)
    assert "mm_per_rev has no meaning for an angle on a servo" in done.stdout + done.stderr
    document = yaml.safe_load(with_wrist(configs, tmp_path, "stiffflop1").read_text())
    (robot,) = document["robots"].values()
    first = next(iter(robot["axes"].values()))
    robot["axes"]["wrist"] = {**first, "channel": "p3"}
    (tmp_path / "stiffflop1.yaml").write_text(yaml.safe_dump(document))
    done = contid_in(tmp_path, "check", "stiffflop1.yaml")
    assert "axis 'wrist' is an angle, but a regulator has no angle" in done.stdout + done.stderr


def test_the_example_of_the_finger_works_as_it_stands(tmp_path: Path, configs: Path) -> None:
    """The commented lines at the end of the file, without their #, added to the robot."""
    text = (configs / "finger.yaml").read_text()
    head, _, example = text.partition("# A wrist and a gripper")
    lines = [line.removeprefix("# ") for line in example.splitlines()[1:] if line.startswith("#   ")]
    added = yaml.safe_load("\n".join(lines))
    document = yaml.safe_load(head)
    robot = document["robots"]["finger"]
    robot["extra_deg"] = added["extra_deg"]
    robot["rates"] |= added["rates"]
    robot["axes"] |= added["axes"]
    (tmp_path / "finger.yaml").write_text(yaml.safe_dump(document))
    done = contid_in(tmp_path, "check", "finger.yaml")
    assert done.returncode == 0, done.stderr
    assert re.search(r"gripper\W+0\W+70\W+deg", done.stdout), done.stdout


def test_clients_get_every_axis_in_its_unit(tmp_path: Path, configs: Path) -> None:
    """What ``describe`` has, as jogging, teaching and the panel read it."""
    loaded = load_robot_file(with_wrist(configs, tmp_path, "finger"))
    described = TelemetryView(loaded, 200.0, lambda: None).describe()
    robot = columns_of(described)["finger"]
    assert robot.axes == ("left_mm", "right_mm", "wrist_deg")
    assert robot.units == ("mm", "mm", "deg")
    assert np.allclose(robot.minimum, [0.0, 0.0, -90.0])
    assert np.allclose(robot.maximum, [100.0, 100.0, 45.0])
    assert np.allclose(robot.axis_rates, [(60, 1000, 20000), (60, 1000, 20000), (180, 3000, 60000)])
    assert described["robots"]["finger"]["columns"][-1] == "wrist_deg"
