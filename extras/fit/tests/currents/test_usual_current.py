"""``contid calibrate currents``: from recordings of a finger to `usual_ma`."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from contid.control.engine import messages as msg
from contid.robot_file.load import load_robot_file, parse_robot_file, with_mock
from contid.targets import Target
from tests.sense.squeeze_runs import BEFORE, closing, hand, hand_text, sense_of
from tests.session.runs import record_virtual
from tests.support.command import contid

pytestmark = pytest.mark.process

FRICTION_MA, NOISE_MA = 60.0, 3.0
#: To and fro before the object, 6 s of motion and more.
THERE = Target(tip_m=(0.010, 0.085, 0.0))
MOTIONS: Mapping[int, Sequence[msg.Message]] = {
    10: [msg.Resume()],
    **{100 + 100 * k: [msg.Goto("left", (BEFORE, THERE)[k % 2])] for k in range(26)},
}


@pytest.fixture(scope="module")
def free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("free")
    return record_virtual(folder / "free.mcap", hand(None), None, MOTIONS, ticks=2720)


def calibrate(*arguments: object) -> tuple[int, str]:
    done = contid("calibrate", "currents", *map(str, arguments))
    return done.returncode, done.stdout + done.stderr


def test_the_friction_of_the_gears_is_found_and_written(free: Path, tmp_path: Path) -> None:
    robot_file = tmp_path / "hand.yaml"
    robot_file.write_text(hand_text(3.0))
    code, out = calibrate(free, free, "--robot", "left", "--write", robot_file)
    assert code == 0, out
    sense = sense_of(robot_file)
    # The greatest of some thousand samples with noise, a fifth above it, in steps of 5 mA.
    assert (
        1.2 * (FRICTION_MA + 2.0 * NOISE_MA) <= sense.usual_ma <= 1.2 * (FRICTION_MA + 5.5 * NOISE_MA) + 5.0
    )
    assert (sense.contact_ma, sense.nm_per_a) == (100, 0.354)
    assert "free.mcap" in robot_file.read_text()
    assert "left.right: at most" in out
    none = tmp_path / "none.yaml"
    none.write_text(hand_text(3.0, sense=""))
    assert calibrate(free, "--robot", "left", "--margin-percent", 0, "--write", none)[0] == 0
    made = sense_of(none)
    assert made.contact == "ignore"
    assert FRICTION_MA < made.usual_ma < sense.usual_ma


def test_sessions_that_do_not_show_it_are_refused(free: Path, tmp_path: Path) -> None:
    touched = record_virtual(tmp_path / "touched.mcap", hand(3.0), None, closing(3.0), ticks=1800)
    code, out = calibrate(free, touched, "--robot", "left")
    assert code == 2
    assert "touched.mcap: tick " in out
    assert "without contact" in out
    code, out = calibrate(free, "--robot", "right")
    assert code == 2
    assert "right.left moves for 0.0 s, 5 s are needed" in out
    for name in ((), ("--robot", "middle")):
        code, out = calibrate(free, *name)
        assert code == 2
        assert "left, right" in out
    silent = with_mock(parse_robot_file(hand_text(None), "hand.yaml"))
    unarmed = record_virtual(tmp_path / "unarmed.mcap", silent, None, {0: [msg.Estop()]}, ticks=100)
    code, out = calibrate(unarmed, "--robot", "left")
    assert code == 2
    assert "no current of left.left" in out


def test_an_arm_without_currents_is_no_finger(tmp_path: Path, configs: Path) -> None:
    arm = tmp_path / "arm.yaml"
    shutil.copy(configs / "stiffflop1.yaml", arm)
    loaded = with_mock(load_robot_file(arm))
    session = record_virtual(tmp_path / "arm.mcap", loaded, None, {}, ticks=50)
    code, out = calibrate(session)
    assert code == 2
    assert "model rack_finger only" in out
