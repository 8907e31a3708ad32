"""From rendered images to the corrected tip: a closed loop in virtual time, and a real daemon."""

import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
import yaml

from contid.control.engine import messages as msg
from contid.control.engine.virtual import VirtualProcess
from contid.control.engine.wiring import build_robot_configs
from contid.robot_file.load import parse_robot_file, with_mock
from contid.targets import Target
from contid_camera.tracker import TipTracker
from tests.support.camera_scene import TIP, WORLD, Scene, places, setup
from tests.support.daemons import armed
from tests.support.daemons import fast_daemon as daemon

pytestmark = pytest.mark.process

FINGER = """
contid: 1
name: seen
rate_hz: 100
buses: {b: {driver: sim}}
robots:
  f:
    model: rack_finger
    base: {y_mm: -60}
    geometry: {rack_spacing_mm: 13, tip_length_mm: 22, link: {length_mm: 6, width_mm: 13, gap_mm: 5}}
    limits: {length_mm: [0, 100]}
    rates: {velocity_mm_s: 60, acceleration_mm_s2: 1000, jerk_mm_s3: 20000}
    rest_mm: [60, 60]
    feedback: {gain_per_s: 4, limit_mm: 15, stale_ms: 300, fade_ms: 200}
    axes:
      left: {bus: b, device: servo, mm_per_rev: 37.7}
      right: {bus: b, device: servo, mm_per_rev: 37.7}
"""


class Sink:
    def write(self, values):
        pass

    def event(self, event):
        pass


def world_of(pose, config):
    """Tip [m] and rotation of the tip frame, whose z is along the body, in the world."""
    tip = np.array(config.frame.point_in_world(pose.tip_m))
    z = np.array(config.frame.vector_in_world(pose.direction))
    x = np.cross([0.0, 0.0, -1.0], z)
    return tip, np.stack([x, np.cross(z, x), z], axis=1)


def test_tip_feedback_from_images_removes_the_error_of_a_wrong_model():
    """The arm bends 8 % more than its model and is 1 mm longer; the camera sees it 12.5 times a second."""
    loaded = with_mock(parse_robot_file(FINGER, "seen.yaml"))
    (config,) = build_robot_configs(loaded, 100.0)
    process = VirtualProcess(loaded, 100.0, Sink(), attended=True)
    scene, tracker, rng = Scene.usual(), TipTracker(setup()), np.random.default_rng(8)
    goal = np.array([0.025, 0.012, 0.0])
    before, after = [], []
    process.engine.arm()
    for tick in range(420):
        process.begin()
        if tick == 20:
            process.engine.obey(msg.Rows({"f": Target(tip_m=tuple(goal.tolist()))}), tick)
        command = process.engine.robots.states[0].command
        if tick % 8 == 0 and tick > 20 and command:
            left, right = command
            middle, bend = 0.5 * (left + right) + 1e-3, 0.5 * (right - left) * 1.08
            tip, rotation = world_of(config.model.forward((middle - bend, middle + bend)), config)
            off_m = float(np.linalg.norm(tip - goal))
            if 100 <= tick < 140:
                before.append(off_m)
            if tick >= 380:
                after.append(off_m)
            if tick >= 140:
                look = tracker.look(scene.image(tip, rotation, rng), tick / 100.0)
                assert look.tip is not None, look.refusal
                process.engine.obey(msg.Measured("f", look.tip.tip_m, look.tip.direction, 0.02), tick)
        process.turn()
    process.close()
    assert min(before) > 2e-3
    assert max(after) < 0.3e-3


@pytest.mark.realtime
def test_a_running_daemon_gets_the_tip_of_a_video(tmp_path):
    """A resting finger in a video: telemetry has the tip that was rendered, and the tracker by name."""
    loaded = parse_robot_file(FINGER, "seen.yaml")
    (config,) = build_robot_configs(loaded, 100.0)
    tip, rotation = world_of(config.model.forward((0.055, 0.060)), config)
    scene, rng = Scene.usual(), np.random.default_rng(9)
    video = cv2.VideoWriter(str(tmp_path / "tip.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (640, 480))
    frames = [cv2.cvtColor(scene.image(tip, rotation, rng), cv2.COLOR_GRAY2BGR) for _ in range(8)]
    for k in range(75):
        video.write(frames[k % len(frames)])
    video.release()
    (tmp_path / "camera.yaml").write_text(setup().camera.text())
    contents = {"contid_track": 1, "camera": "camera.yaml", "world": places(WORLD), "tip": places(TIP)}
    (tmp_path / "track.yaml").write_text(yaml.safe_dump(contents))
    with daemon(change=lambda _: FINGER) as running, running.client() as client:
        armed(client)
        command = [sys.executable, "-m", "contid", "track", "f", "--camera", "tip.avi", "--socket"]
        tracker = subprocess.Popen(
            [*command, str(running.socket)], cwd=tmp_path, stderr=subprocess.PIPE, text=True
        )
        seen = client.telemetry(20.0, fields=["measured_tip_mm"])
        measured, give_up_s = None, time.monotonic() + 60.0
        while measured is None and time.monotonic() < give_up_s:
            measured = next(seen)["robots"]["f"]["measured_tip_mm"]
        _, output = tracker.communicate(timeout=30)
        assert tracker.returncode == 0, output
        assert "75 of 75 images measured" in output
        assert measured is not None
        assert np.linalg.norm(np.array(measured[:2]) - 1e3 * tip[:2]) < 0.3
