"""Teaching on emulated servos, end to end: shafts turned by hand, saved, recorded, replayed."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from contid.client import Client, RemoteError
from contid.remote.protocol.socket_path import is_listening
from tests.support.command import contid_in, emulating, environment
from tests.support.daemons import armed, command, daemon, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]
#: Of the shipped file: a turn of the pinion.
MM_PER_REV = 37.69911184307752


@contextmanager
def started(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        command(*arguments), cwd=folder, env=environment(), text=True, stdout=subprocess.PIPE,
        stdin=subprocess.DEVNULL if arguments[0] == "run" else subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def press(process: subprocess.Popen[str], keys: str, answer: str) -> str:
    """Press keys and return the line with the answer."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(keys)
    process.stdin.flush()
    return line_with(process, answer)


def line_with(process: subprocess.Popen[str], text: str) -> str:
    assert process.stdout is not None
    seen = []
    for line in process.stdout:
        seen.append(line)
        if text in line:
            return line
    assert process.stderr is not None
    raise AssertionError(f"{text!r} is not in {seen}: {process.stderr.read()}")


def test_shafts_are_turned_by_hand_saved_recorded_and_replayed(configs: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="contid-") as name:
        folder = Path(name)
        text = (
            (configs / "finger.emulated.yaml")
            .read_text()
            .replace("tolerance_ticks: 10", "tolerance_ticks: 400")
        )
        text = text.replace(
            "baud: 1000000\n", "baud: 1000000\n    usb_latency_ms: 40\n    watchdog_ms: 2000\n"
        )
        (folder / "finger.yaml").write_text(text)

        def push(device: int, mm: float, ms: float) -> None:
            with (folder / "faults.jsonl").open("a") as file:
                degrees = 360.0 * mm / MM_PER_REV
                file.write(json.dumps({"fault": "push", "id": device, "degrees": degrees, "ms": ms}) + "\n")

        (folder / "faults.jsonl").touch()
        with (
            emulating(folder, "finger.yaml", "--faults", "faults.jsonl"),
            started(folder, "run", "finger.yaml", "--socket", "s", "--json"),
        ):
            until(lambda: is_listening(folder / "s"), "the daemon listens")
            with Client(folder / "s") as client:
                armed(client)

                def measured() -> list[float]:
                    axes = client.status()["robots"]["finger"]["axes"].values()
                    return [axis["measured_mm"] for axis in axes]

                start = measured()
                push(1, 8.0, 100.0)  # under torque it resists
                time.sleep(0.5)  # the push is over before torque goes off
                with started(folder, "teach", "--socket", "s", "--yes") as teach:
                    assert "torque is off" in line_with(teach, "finger: torque is off")
                    line_with(teach, "Keys:")
                    assert states(client) == {"OFF"}
                    assert measured() == pytest.approx(start, abs=0.1)
                    with pytest.raises(RemoteError, match="contid teach"):
                        client.resume()  # hands are on the robot
                    push(1, 8.0, 200.0)
                    until(lambda: measured()[0] > start[0] + 7.9, "the shaft was turned")
                    assert measured() == pytest.approx([start[0] + 8.0, start[1]], abs=0.1)
                    assert "saved bent" in press(teach, "sbent\n", "bent")
                    press(teach, "r", "recording; r ends it")
                    push(2, 6.0, 600.0)
                    until(lambda: measured()[1] > start[1] + 5.9, "the other shaft was turned")
                    recorded = press(teach, "r", "recorded")
                    assert "motion1.csv" in recorded
                    assert "saved pose1" in press(teach, "s\n", "pose1")
                    press(teach, "q", "contid resume arms")
                    teach.wait(20)
                    assert teach.returncode == 0
                poses = yaml.safe_load((folder / "finger.poses.yaml").read_text())
                assert poses["poses"]["bent"]["target"] == pytest.approx(
                    {"left_mm": start[0] + 8.0, "right_mm": start[1]}, abs=0.1
                )
                assert poses["poses"]["bent"]["saved"].endswith("contid teach, finger.yaml")
                # `contid check` is what a run does before it begins; then the running daemon plays it.
                checked = contid_in(folder, "check", "finger.yaml", "motion1.csv")
                assert checked.returncode == 0, checked.stdout + checked.stderr
                with (folder / "finger.poses.yaml").open("a") as file:
                    file.write("sequence:\n  - {pose: bent}\n  - {trajectory: motion1.csv}\n")
                assert contid_in(folder, "resume", "--socket", "s").returncode == 0
                armed(client)
                played = contid_in(folder, "play", "finger.poses.yaml", "--socket", "s")
                assert played.returncode == 0, played.stderr
                until(
                    lambda: measured() == pytest.approx([start[0] + 8.0, start[1] + 6.0], abs=0.2),
                    "the replay ends where the hand did",
                )
                assert contid_in(folder, "move", "--pose", "bent", "--socket", "s").returncode == 0
                until(
                    lambda: measured() == pytest.approx([start[0] + 8.0, start[1]], abs=0.2),
                    "it is bent again",
                )


def test_poses_of_an_armed_robot_are_saved_and_mistakes_named() -> None:
    with daemon(2) as running, running.client() as client:
        armed(client)
        socket = ("--socket", str(running.socket))
        done = contid_in(running.folder, "teach", "f9", *socket)
        assert "no robot 'f9'; allowed: f0, f1" in done.stderr
        with started(running.folder, "teach", "f1", "--keep", "-o", "p.yaml", *socket) as teach:
            line_with(teach, "Keys:")
            assert states(client) == {"HOLD"}
            press(teach, "stwo words\n", "'two words' is no name of a pose")
            press(teach, "s\x1bx", "not saved")
            press(teach, "shome\n", "saved home")
            press(teach, "shome\n", "replaced home")
            press(teach, "rr", "not recorded: ")
            teach.communicate(timeout=20)  # the end of the input ends it
            assert teach.returncode == 0
        poses = yaml.safe_load((running.folder / "p.yaml").read_text())["poses"]
        assert poses["home"]["target"] == pytest.approx({"f1.left_mm": 50.0, "f1.right_mm": 50.0}, abs=0.1)
        # Without --yes and without an answer nothing is switched off.
        done = contid_in(running.folder, "teach", "f0", *socket)
        assert done.returncode == 2
        assert "stdin ended where an answer was expected" in done.stderr
        assert states(client) == {"HOLD"}
        client.acquire(60.0)
        done = contid_in(running.folder, "teach", "f0", "--yes", *socket)
        assert done.returncode == 2
        assert "has held the lease" in done.stderr
        assert states(client) == {"HOLD"}
