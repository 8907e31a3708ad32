"""The LeRobot plugin of examples/lerobot against a daemon, with LeRobot's base classes cut short.

``CONTID_LEROBOT=PYTHON pytest tests/docs/test_lerobot.py -m campaign``: with LeRobot itself,
by the Python of an environment where lerobot is installed: it teleoperates, records and replays.
"""

from __future__ import annotations

import abc
import importlib
import json
import math
import os
import subprocess
import sys
import time
import types
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from contid.client import Client, ConnectionLostError, RemoteError, ServoState
from contid.remote.protocol.socket_path import is_listening
from tests.support.waiting import until

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent
PLUGIN = ROOT / "examples" / "lerobot"
#: Abstract members of LeRobot 0.4.4 and 0.6.2.
BOTH = "action_features is_connected is_calibrated connect calibrate configure disconnect "


def base(members: str) -> type:
    def begin(self: Any, config: Any) -> None:
        self.id = config.id

    names = dict.fromkeys(members.split(), abc.abstractmethod(lambda self: None))
    return abc.ABCMeta("Base", (), {**names, "__init__": begin})


class Registered:
    id: str | None = None

    @classmethod
    def register_subclass(cls, name: str) -> Any:
        return lambda kind: kind


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Any:
    errors = {
        name: type(name, (ConnectionError,), {})
        for name in ("DeviceAlreadyConnectedError", "DeviceNotConnectedError")
    }
    for name, members in {
        "lerobot": {},
        "lerobot.utils": {},
        "lerobot.utils.errors": errors,
        "lerobot.robots": {
            "Robot": base(BOTH + "observation_features get_observation send_action"),
            "RobotConfig": Registered,
        },
        "lerobot.teleoperators": {
            "Teleoperator": base(BOTH + "feedback_features get_action send_feedback"),
            "TeleoperatorConfig": Registered,
        },
    }.items():
        module = types.ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PLUGIN))
    yield importlib.import_module("lerobot_robot_contid")
    for name in [each for each in sys.modules if each.startswith("lerobot_robot_contid")]:
        del sys.modules[name]


@pytest.fixture
def sockets(tmp_path: Path) -> Iterator[list[Path]]:
    """Two daemons of the same robot: a follower and a leader."""
    command = [sys.executable, "-m", "contid", "run", "finger", "--mock", "-q"]
    paths = [tmp_path / "follower", tmp_path / "leader"]
    daemons = [
        subprocess.Popen(
            [*command, "--socket", str(path)],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for path in paths
    ]
    try:
        for path in paths:
            until(partial(is_listening, path), "the daemon listens")
        yield paths
    finally:
        for each in daemons:
            each.terminate()
            each.wait(60)


def test_a_leader_moves_a_follower_within_its_limits(plugin: Any, sockets: list[Path]) -> None:
    follower, leader = (str(path) for path in sockets)
    robot = plugin.ContidRobot(plugin.ContidRobotConfig(socket=follower))
    assert [*robot.action_features] == ["left_mm", "right_mm"]
    assert [*robot.observation_features] == ["left_mm", "right_mm", "tip_x_mm", "tip_y_mm", "tip_z_mm"]
    assert robot.cameras == {}  # its length is asked for by lerobot-record
    with pytest.raises(ConnectionError):
        robot.get_observation()
    teleoperator = plugin.ContidLeader(plugin.ContidLeaderConfig(socket=leader))
    assert teleoperator.action_features == robot.action_features
    with Client(leader) as hand:
        hand.resume()
        hand.move({"left_mm": 56.0, "right_mm": 52.0})
    robot.connect()
    teleoperator.connect()
    sent = robot.send_action(teleoperator.get_action())
    assert sent["left_mm"] == pytest.approx(56.0, abs=0.3)
    until(lambda: abs(robot.get_observation()["left_mm"] - 56.0) < 0.4, "the follower is there")
    # Numbers that are none leave an axis as it was asked last; limits are the daemon's.
    assert robot.send_action({"left_mm": math.nan, "right_mm": 1e9}) == {**sent, "right_mm": 100.0}
    robot.send_action(sent)
    with Client(follower) as operator:
        operator.stop()
    with pytest.raises(ConnectionError, match="stop"):
        until(lambda: robot.send_action(sent) is None, "the stop of another client ends the stream")
    robot.disconnect()
    teleoperator.disconnect()
    assert not robot.is_connected


@pytest.mark.campaign
@pytest.mark.timeout(3600)  # beside other work each of its three commands imports for minutes
def test_lerobot_teleoperates_records_and_replays(sockets: list[Path], tmp_path: Path) -> None:
    python = os.environ.get("CONTID_LEROBOT")
    if python is None:
        pytest.skip("CONTID_LEROBOT is not set: a Python with lerobot")
    site = tmp_path / "site" / "lerobot_robot_contid-1.0.dist-info"
    site.mkdir(parents=True)
    (site / "METADATA").write_text("Metadata-Version: 2.1\nName: lerobot_robot_contid\nVersion: 1.0\n")
    path = os.pathsep.join(map(str, (site.parent, PLUGIN, ROOT)))
    home = {**os.environ, "PYTHONPATH": path, "HF_LEROBOT_HOME": str(tmp_path / "hf"), "HF_HUB_OFFLINE": "1"}
    follower, leader = (str(each) for each in sockets)
    robot = ["--robot.type=contid", f"--robot.socket={follower}", "--robot.id=a"]
    hand = ["--teleop.type=contid", f"--teleop.socket={leader}", "--teleop.id=b"]
    data = ["--dataset.repo_id=lab/circle", f"--dataset.root={tmp_path / 'data'}"]

    def lerobot(script: str, *arguments: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen([python, "-m", f"lerobot.scripts.lerobot_{script}", *arguments], env=home)

    def posture(at: ServoState) -> dict[str, float]:
        return {"left_mm": 50 + 5 * math.sin(at.time_s), "right_mm": 50 + 5 * math.cos(at.time_s)}

    def circle(seconds: float) -> None:
        """The leader's tip is moved by hand, so to speak."""
        with Client(leader) as client:
            client.resume()
            client.servo(50, lambda at: None if at.time_s > seconds else posture(at))

    with lerobot("teleoperate", *robot, *hand, "--fps=30", "--teleop_time_s=3") as done:
        circle(1.0)
        assert done.wait(1200) == 0
    record = [
        *("--dataset.single_task=circle", "--dataset.num_episodes=1", "--dataset.episode_time_s=6"),
        *("--dataset.reset_time_s=0", "--dataset.fps=30", "--dataset.push_to_hub=false"),
        *("--dataset.video=false", "--play_sounds=false"),
    ]
    with lerobot("record", *robot, *hand, *data, *record) as done:
        while done.poll() is None:
            with suppress(RemoteError, ConnectionLostError):  # a host that holds this process for seconds
                circle(2.0)
    assert done.returncode == 0
    about = json.loads((tmp_path / "data" / "meta" / "info.json").read_text())
    assert about["features"]["action"]["names"] == ["left_mm", "right_mm"]
    assert about["total_frames"] > 60
    with (
        Client(follower) as client,
        lerobot("replay", *robot, *data, "--dataset.episode=0", "--play_sounds=false") as done,
    ):
        seen = []
        while done.poll() is None:
            seen.append(client.status()["robots"]["finger"]["axes"]["left"]["measured_mm"])
            time.sleep(0.02)
    assert done.returncode == 0
    assert max(seen) - min(seen) > 5.0
