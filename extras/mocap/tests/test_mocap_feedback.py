"""Closed loop through a real daemon: emulated rooms see a finger that is not as its model."""

import math
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import build_model
from contid.robot_file.load import parse_robot_file
from tests.support.daemons import fast_daemon as daemon
from tests.support.fingers import fingers
from tests.support.mocap.rooms import emulated_room, setup_file
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

TARGET_MM = (30.0, 70.0)
CORRECTION = "correction: {a_per_mm: 0.0013, b: -0.2774, arc_length_mm: [0, 213.4]}"
ROOM = "room: {up: y, x_mm: 250, y_mm: -80, z_mm: 40, yaw_deg: 30, pitch_deg: 5}"
#: The same by SciPy: p_world = R U p_room + t.
UP = Rotation.from_euler("x", 90, degrees=True)
PLACED = Rotation.from_euler("ZYX", [30, 5, 0], degrees=True) * UP
AT_M = np.array([0.25, -0.08, 0.04])
BODY_MM = 35.0


def with_feedback(text):
    # A busy machine delivers late: the correction must not fade between two measurements.
    return text.replace(CORRECTION, "feedback: {stale_ms: 500}")


def plant():
    """The same finger, ten percent more curved."""
    text = with_feedback(fingers(1)).replace("rack_spacing_mm: 13", f"rack_spacing_mm: {13 / 1.1}")
    text = text.replace("link: {length_mm: 6, width_mm: 13", "link: {length_mm: 6, width_mm: 8")
    return parse_robot_file(text, "plant.yaml").file.robots["f0"]


def seen_by_the_room(tip_m, direction):
    """Pose of the body on the tip, whose z is along the finger, in the room."""
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    body = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=1))
    origin = np.array(tip_m) - z * BODY_MM / 1e3
    in_room = PLACED.inv()
    return [*in_room.apply(origin - AT_M).tolist(), *(in_room * body).as_quat().tolist()]


@pytest.mark.parametrize("kind", ["natnet", "vicon"])
def test_feedback_from_a_room_takes_the_error_of_a_wrong_model(tmp_path, kind):
    x, y = TARGET_MM
    (tmp_path / "t.csv").write_text(f"t_s,x_mm,y_mm\n0,{x},{y}\n600,{x},{y}\n")
    setup_file(tmp_path, f"contid_mocap: 1\n{ROOM}\nrobots: {{f0: {{body: tip, z_mm: {BODY_MM}}}}}\n")
    truth = plant()
    model, frame = build_model(truth), BaseFrame.of(truth.base)
    arguments = ("--trajectory", str(tmp_path / "t.csv"), "--on-end", "hold")
    with (
        daemon(1, *arguments, change=with_feedback) as running,
        running.client() as client,
        running.client(name="plant") as watcher,
        emulated_room(kind, "tip", "--rate-hz", "50", poses=True) as room,
    ):

        def tip_of(measured_mm):
            pose = model.forward(tuple(value / 1e3 for value in measured_mm))
            return frame.point_in_world(pose.tip_m), frame.vector_in_world(pose.direction)

        def error_mm():
            time.sleep(0.1)  # the daemon has measurements to take too
            axes = client.status()["robots"]["f0"]["axes"].values()
            tip_m, _ = tip_of([axis["measured_mm"] for axis in axes])
            return math.dist([1e3 * value for value in tip_m[:2]], TARGET_MM)

        ended = threading.Event()

        def play():
            for seen in watcher.telemetry(50.0, fields=["measured"]):
                if ended.is_set():
                    return
                if (measured := seen["robots"]["f0"]["measured"]) is not None:
                    room.pose({"tip": seen_by_the_room(*tip_of(measured))})

        until(lambda: client.status()["robots"]["f0"]["state"] == "RUN", "it follows")
        begun = client.status()["tick"]
        until(lambda: client.status()["tick"] > begun + 100, "half a second")
        open_loop_mm = error_mm()
        assert open_loop_mm > 1.0, "the plant must be wrong enough to matter"
        player = threading.Thread(target=play)
        player.start()
        port = "--command-port" if kind == "natnet" else "--port"
        here = ("--server", "127.0.0.1", "--local", "127.0.0.1", port, str(room.port))
        tracker = subprocess.Popen(
            [sys.executable, "-m", "contid", "track", kind, "f0", *here, "--socket", str(running.socket)],
            cwd=tmp_path,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            until(lambda: error_mm() < 0.05 * open_loop_mm, "95 % of the error are gone")
            assert client.status()["trackers"]["f0"]["name"] == "contid track"
            (seen,) = (
                each
                for _, each in zip(range(1), client.telemetry(fields=["measured_direction"]), strict=False)
            )
            assert seen["robots"]["f0"]["measured_direction"] is not None
        finally:
            tracker.send_signal(signal.SIGINT)
            print(tracker.communicate(timeout=20)[1])  # shown when the test fails
            ended.set()
            player.join(10)
        killed = client.status()["tick"]
        until(lambda: client.status()["tick"] > killed + 300, "a second and a half later")
        assert error_mm() == pytest.approx(open_loop_mm, abs=0.05 * open_loop_mm)
