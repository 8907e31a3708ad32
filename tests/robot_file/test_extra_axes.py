"""Axes beyond the kinematics: any robot may have them, in the unit of its own axes."""

from __future__ import annotations

import csv
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from contid.robot_file.load import load_robot_file
from tests.support.command import contid_in

#: Robot file -> the extra axis as it is written, and what its device has beyond that of the first axis.
ROBOTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "finger": ({"extra_mm": {"wrist": [-20, 20]}}, {"id": 7}),
    "trirack": ({"extra_mm": {"grip": [0, 60]}}, {"channel": "m3"}),
    "tendon3": ({"extra_mm": {"grip": [0, 30]}}, {"id": 40}),
    "stiffflop1": ({"extra_bar": {"grip": [0, 1]}}, {"channel": "p3"}),
}


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


@pytest.mark.parametrize("name", ROBOTS)
def test_it_is_driven_beside_the_model(name: str, tmp_path: Path, configs: Path) -> None:
    ((name_of, robot),) = load_robot_file(with_extra(configs, tmp_path, name)).file.robots.items()
    axis, unit = robot.extra_axis_names[0], robot.quantity.unit
    low, high = (robot.quantity.from_si(end) for end in robot.extra_limits[axis])
    columns = [f"{each}_{unit}" for each in robot.all_axis_names]
    rest = [robot.quantity.from_si(each) for each in robot.rest]

    def run(end: float) -> subprocess.CompletedProcess[str]:
        rows = [(0.0, *rest, low), (10.0, *rest, end)]
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
    assert f"{axis}.max" in refused.stderr


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
