"""`contid move --pose` and `contid play` on a daemon with simulated devices."""

from __future__ import annotations

import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.support.daemons import Running, armed, arrives, command, daemon, states
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

POSES = """\
contid_poses: 1
poses:
  here: {target: {x_mm: 50, y_mm: 75}}
  far: {target: {x_mm: 30, y_mm: 85}}
  straight: {target: {left_mm: 60, right_mm: 60}}
  beyond: {target: {left_mm: 60, right_mm: 101}}
  unreachable: {target: {x_mm: 900, y_mm: 85}}
sequence:
  - {pose: here}
  - {pose: far, time_s: 0.5, wait_s: 0.2}
  - {loop: 2, steps: [{pose: straight, time_s: 0.4}, {trajectory: line.csv}]}
"""
LINE = "t_s,x_mm,y_mm\n0,50,75\n0.3,48,75\n"


def contid(running: Running, *arguments: str) -> subprocess.CompletedProcess[str]:
    done = [*command(*arguments), "--socket", str(running.socket)]
    return subprocess.run(done, capture_output=True, text=True, timeout=60, cwd=running.folder, check=False)


def test_poses_are_moved_to_and_sequences_played() -> None:
    with daemon() as running, running.client() as client:
        armed(client)
        (running.folder / "fingers.poses.yaml").write_text(POSES)
        (running.folder / "line.csv").write_text(LINE)
        done = contid(running, "move", "--pose", "far")
        assert done.returncode == 0, done.stderr
        arrives(client, "f0", (30.0, 85.0, 0.0))
        done = contid(running, "play", "fingers.poses.yaml")
        assert done.returncode == 0, done.stderr
        assert done.stdout.splitlines() == [
            "pose here",
            "pose far in 0.5 s",
            "wait 0.2 s",
            *(["pose straight in 0.4 s", "trajectory line.csv"] * 2),
        ]
        arrives(client, "f0", (48.0, 75.0, 0.0))
        done = contid(running, "play", "fingers.poses.yaml", "straight", "here", "--repeat", "2")
        assert done.stdout.splitlines() == ["pose straight", "pose here"] * 2, done.stderr
        assert "client" not in client.status()["lease"]
        # Mistakes move nothing and have their place.
        before = client.status()["robots"]["f0"]["target_mm"]
        for arguments, message in (
            (("move", "--pose", "fra"), "no pose 'fra'; allowed: here, far"),
            (("move", "--pose", "beyond"), "fingers.poses.yaml:6:44: right_mm: 101 is outside its limits"),
            (("play", "fingers.poses.yaml", "here", "beyond"), ":6:44: right_mm: 101 is outside its limits"),
            (("move", "--pose", "unreachable"), "out of reach"),
            (("play", "fingers.poses.yaml", "unreachable"), "fingers.poses.yaml:7:3: pose 'unreachable': "),
            (("move", "x_mm=1", "--pose", "far"), "one of them"),
            (("play", "none.yaml"), "none.yaml: cannot read it: No such file"),
        ):
            done = contid(running, *arguments)
            assert done.returncode == 2, done.stdout
            assert message in done.stderr
            assert client.status()["robots"]["f0"]["target_mm"] == before
        # Too fast for the rates of the robot file: the preflight of the daemon refuses it, with its place.
        (running.folder / "fast.yaml").write_text(
            POSES.partition("sequence:")[0] + "sequence:\n  - {pose: straight, time_s: 0.02}\n"
        )
        done = contid(running, "play", "fast.yaml")
        assert done.returncode == 2
        assert "fast.yaml:9:5: pose 'straight': " in done.stderr
        assert client.status()["robots"]["f0"]["target_mm"] == before


def test_a_stop_ends_the_sequence_and_an_interrupt_holds() -> None:
    poses = (
        POSES.partition("sequence:")[0]
        + "sequence:\n  - {pose: here, time_s: 1}\n  - {pose: far, time_s: 1}\n"
    )
    with daemon(1, "--on-end", "hold") as running, running.client() as client:
        armed(client)
        (running.folder / "p.yaml").write_text(poses)

        def playing() -> subprocess.Popen[str]:
            arguments = [*command("play", "p.yaml", "--repeat", "0"), "--socket", str(running.socket)]
            process = subprocess.Popen(arguments, cwd=running.folder, stderr=subprocess.PIPE, text=True)
            until(lambda: states(client) == {"RUN"} or process.poll() is not None, "it plays")
            return process

        process = playing()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
        assert process.returncode == 130
        until(lambda: states(client) == {"HOLD"}, "the robot holds")
        process = playing()
        client.stop()
        _, message = process.communicate(timeout=20)
        assert process.returncode != 0
        assert "p.yaml:" in message
        time.sleep(0.2)
        assert states(client) <= {"HOLD", "STOPPING", "OFF"}


def test_a_sequence_that_was_stopped_does_not_go_on_when_the_robots_are_armed_again() -> None:
    """The stop comes while it waits, and is over before the next step."""
    poses = POSES.partition("sequence:")[0] + "sequence:\n  - {pose: here, wait_s: 3}\n  - {pose: far}\n"
    with daemon(1, "--on-end", "hold") as running, running.client() as client:
        armed(client)
        (running.folder / "p.yaml").write_text(poses)
        process = subprocess.Popen(
            [*command("play", "p.yaml"), "--socket", str(running.socket)],
            cwd=running.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        arrives(client, "f0", (50.0, 75.0, 0.0))
        until(lambda: states(client) == {"HOLD"}, "it waits")
        client.stop()
        until(lambda: states(client) == {"OFF"}, "it stopped")
        client.resume(after_stop=True)
        stands = client.status()["robots"]["f0"]["tip_mm"]
        done, message = process.communicate(timeout=20)
        assert process.returncode == 2, done
        assert re.search(r"p\.yaml:9:5: pose 'here': .* the sequence ends", message)
        assert client.status()["robots"]["f0"]["tip_mm"] == pytest.approx(stands, abs=0.1)


def test_a_trajectory_without_times_is_refused_before_anything_moves() -> None:
    sequence = "sequence:\n  - {pose: here}\n  - {loop: 2, steps: [{trajectory: live.csv}]}\n"
    with daemon() as running, running.client() as client:
        armed(client)
        (running.folder / "p.yaml").write_text(POSES.partition("sequence:")[0] + sequence)
        (running.folder / "live.csv").write_text("x_mm,y_mm\n50,75\n48,75\n50,75\n")
        before = client.status()["robots"]["f0"]["target_mm"]
        done = contid(running, "play", "p.yaml")
        assert done.returncode == 2
        assert re.search(r"p\.yaml:10:\d+: live\.csv: no column 't_s'", done.stderr)
        assert client.status()["robots"]["f0"]["target_mm"] == before


def test_play_without_a_daemon_and_without_a_sequence(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(POSES.partition("sequence:")[0])
    done = subprocess.run(
        [*command("play", str(path)), "--socket", str(tmp_path / "none")],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "no daemon" in done.stderr
