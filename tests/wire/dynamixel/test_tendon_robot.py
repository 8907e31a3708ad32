"""`tendon3` on emulated servos, as a user runs it: tensioned, run, a tendon snaps, recorded and replayed."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from contid.client import Client
from contid.control.engine.wiring import wired_buses
from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import load_robot_file
from contid.session.read import Session
from contid_emulate.dynamixel.bench import servo_of, tendons_of
from tests.kinematics.tendon_robots import shipped
from tests.support.command import environment
from tests.support.waiting import until

pytestmark = pytest.mark.process

PATIENT = "usb_latency_ms: 15\n    watchdog_ms: 400"
HOMING = ", homing: {method: tension, direction: 1, current_ma: 80}}"
#: Of the tendon that snaps: the backbone springs back, so that others carry nothing either.
WATCHED = HOMING.replace("80}", "80, slack_ma: 12}")


def arm(folder: Path, configs: Path) -> Path:
    """The shipped file, tensioned and watched; slower, with long time-outs: tests share the machine."""
    text = (configs / "tendon3.emulated.yaml").read_text().split("    placeholder:")[0]
    text = text.replace("./tendon3.tty", str(folder / "tendon3.tty")).replace("rate_hz: 100", "rate_hz: 50")
    text = text.replace("tolerance_ticks: 5 ", f"tolerance_ticks: 20\n    {PATIENT} ")
    text = re.sub(r"(s1.t3: .*mm_per_rev: [0-9.]+)}", rf"\1{WATCHED}", text)
    (folder / "arm.yaml").write_text(re.sub(r"(mm_per_rev: [0-9.]+)}", rf"\1{HOMING}", text))
    return folder / "arm.yaml"


def contid(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "contid", *words],
        cwd=folder, env=environment(), stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip


def done(process: subprocess.Popen[str]) -> str:
    out, _ = process.communicate(timeout=60)
    return out


def wait_until_taut(socket: Path) -> None:
    """The tip stands at its target, and every spool carries its tendon."""
    with Client(socket, name="test") as client:
        for frame in client.telemetry(20.0, fields=["state", "tip_mm", "effort"]):
            robot = frame["robots"]["arm"]
            at = math.dist(robot["tip_mm"], (60.0, 20.0, 280.0)) < 3.0
            if robot["state"] == "RUN" and at and min(robot["effort"]) > 0.012:
                return


def test_the_emulated_backbone_has_the_tensions_of_the_model(tmp_path: Path, configs: Path) -> None:
    (bus,) = wired_buses(load_robot_file(arm(tmp_path, configs)))
    servos = [servo_of(axis, 1_000_000) for axis in bus.axes]
    (plant,) = tendons_of(servos, bus.axes)
    plant.held = False
    model, rng = shipped("tendon3"), np.random.default_rng(1)
    assert model.statics is not None
    per_m, ma_per_n = 4096 / (2 * np.pi * 0.010), 1470.0 / 0.52 * 0.010
    rest = model.statics.rest_n / model.statics.tendon_n_per_m
    for bends in rng.uniform(-0.8, 0.8, (20, 6)):
        pulls = model.statics.pulls(bends)
        for servo, pull in zip(servos, (rest + pulls) * per_m, strict=True):
            servo.motion.position = float(pull)
        np.testing.assert_allclose(plant.tensions_ma(), ma_per_n * model.statics.tensions(pulls), rtol=1e-6)


def test_a_snapped_tendon_leaves_the_others_in_balance(tmp_path: Path, configs: Path) -> None:
    (bus,) = wired_buses(load_robot_file(arm(tmp_path, configs)))
    servos = [servo_of(axis, 1_000_000) for axis in bus.axes]
    (plant,) = tendons_of(servos, bus.axes)
    plant.held = False
    rng = np.random.default_rng(2)
    plant.snap(4)
    for _ in range(50):
        for servo in servos:
            servo.motion.position = float(rng.uniform(-600.0, 800.0))
        tensions = plant.tensions_ma()
        assert tensions[4] == 0.0
        assert np.min(tensions) >= 0.0
        # The moments of the tendons are those of the bent backbone: the energy is least.
        moments = plant._matrix.T @ tensions
        least = 1e-6 * (1.0 + np.max(abs(moments)))
        np.testing.assert_allclose(moments, plant._bending * plant._bends, atol=least)


@pytest.mark.slow
@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.timeout(180)
def test_a_tendon_snaps_while_the_robot_runs(tmp_path: Path, configs: Path) -> None:
    arm(tmp_path, configs)
    faults = tmp_path / "faults.jsonl"
    rows = ["t_s,arm.x_mm,arm.y_mm,arm.z_mm", "0,60,0,280", "1,60,20,280", "60,60,20,280"]
    (tmp_path / "rest.csv").write_text("\n".join(rows) + "\n")
    run = ("run", "arm.yaml", "--trajectory", "rest.csv")
    started = [contid(tmp_path, "emulate", "dynamixel", "arm.yaml", "--faults", "faults.jsonl")]
    try:
        until(lambda: (tmp_path / "tendon3.tty").is_symlink(), "the port is there")
        assert "run `contid home`" in done(contid(tmp_path, *run))
        homed = done(contid(tmp_path, "home", "arm.yaml"))
        assert homed.count("tension with 80 mA") == 9, homed
        faults.write_text('{"fault": "tube", "on": false}\n')
        started.append(running := contid(tmp_path, *run, "--record", "s.mcap", "--socket", "s"))
        until(lambda: is_listening(tmp_path / "s") or running.poll() is not None, "it listens")
        wait_until_taut(tmp_path / "s")
        with faults.open("a") as file_:
            file_.write('{"fault": "snap", "id": 3}\n')
        out = done(running)
        assert running.returncode == 3, out
        assert "fault 111 tendon-snapped: arm.s1.t3: snapped tendon: " in out, out
    finally:
        for process in started:
            process.terminate()
            process.communicate(timeout=30)
    assert not (tmp_path / "faults.jsonl.errors").exists()
    replayed = contid(tmp_path, "replay", "s.mcap")
    assert "every command is the same, bit for bit" in done(replayed)
    session = Session(tmp_path / "s.mcap")
    assert len(list(session.ticks())) > 50
    assert session.end.clean, session.end.cut
