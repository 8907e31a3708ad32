"""``contid track natnet`` and ``vicon`` as processes, with emulated rooms in processes of their own."""

import csv
import io
import math
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.command import contid_in
from tests.support.mocap.rooms import emulated_room, setup_file
from tests.support.ports import free_port

pytestmark = pytest.mark.process

HERE = ("--server", "127.0.0.1", "--local", "127.0.0.1")
SETUP = "contid_mocap: 1\nroom: {up: z}\nrobots:\n  arm: {body: tip, z_mm: 10}\n"


def track(folder, kind, room, *arguments):
    port = "--command-port" if kind == "natnet" else "--port"
    return contid_in(folder, "track", kind, *HERE, port, str(room.port), *arguments)


def started(folder, room):
    """A tracker that prints until it is interrupted."""
    return subprocess.Popen(
        [
            *(sys.executable, "-m", "contid", "track", "natnet", *HERE),
            *("--command-port", str(room.port), "--print"),
        ],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def rows(done):
    return list(csv.DictReader(io.StringIO(done.stdout)))


@pytest.mark.parametrize("version", ["3.0", "3.1", "4.0", "4.1"])
def test_rows_of_a_circle_come_from_every_version(tmp_path, version):
    setup_file(tmp_path, SETUP)
    with emulated_room("natnet", "tip=0.1,0.2,0.3", "--version", version, "--rate-hz", "100") as room:
        done = track(tmp_path, "natnet", room, "--print", "--for", "1.5")
    assert done.returncode == 0, done.stderr
    assert f"NatNet {version}; its clock is known to" in done.stderr
    found = rows(done)
    assert len(found) > 50
    for row in found:
        radius = math.hypot(float(row["x_mm"]) - 100.0, float(row["y_mm"]) - 200.0)
        assert radius == pytest.approx(20.0, abs=1e-3)
        assert float(row["z_mm"]) == pytest.approx(310.0, abs=1e-3)
        assert [float(row[axis]) for axis in ("ax", "ay", "az")] == [0.0, 0.0, 1.0]


def test_the_capture_is_that_of_the_exposure_not_of_the_arrival(tmp_path):
    """The server sends 30 ms after the exposure; on this machine `time.monotonic` of both is the same."""
    setup_file(tmp_path, SETUP)
    for arguments, bound_ms in (((), 5.0), (("--no-echo",), 15.0)):
        with emulated_room("natnet", "tip", "--delay-ms", "30", "--rate-hz", "50", *arguments) as room:
            done = track(tmp_path, "natnet", room, "--print", "--for", "2.5")
        found = rows(done)
        assert found, done.stderr
        # Exposures are 20 ms apart; the place on the circle is the time of each.
        late_ms = []
        first = None
        for row in found:
            angle = math.atan2(float(row["y_mm"]), float(row["x_mm"]))
            turns_s = angle / (0.5 * math.pi)
            off_s = (float(row["t_s"]) - turns_s) % 4.0
            first = off_s if first is None else first
            late_ms.append(1e3 * ((off_s - first + 2.0) % 4.0 - 2.0))
        assert max(late_ms) - min(late_ms) < bound_ms
        latency = re.search(r"p50 ([\d.]+)", done.stderr)
        assert latency is not None
        assert float(latency[1]) > 25.0


def test_lost_frames_and_hidden_bodies_are_counted_and_not_measured(tmp_path):
    setup_file(tmp_path, SETUP)
    with emulated_room("natnet", "tip", "--loss", "0.2", "--rate-hz", "200", poses=True) as room:
        room.pose({"tip": [0, 0, 0.1, 0, 0, 0, 1]})
        seen = track(tmp_path, "natnet", room, "--print", "--for", "1.5")
        room.pose({"tip": None})
        hidden = track(tmp_path, "natnet", room, "--print", "--for", "1")
    assert seen.returncode == 0, seen.stderr
    counts = re.search(r"(\d+) of (\d+) poses measured; (\d+) frames did not arrive", seen.stderr)
    assert counts is not None
    looked, missing = int(counts[2]), int(counts[3])
    assert 0.1 < missing / (looked + missing) < 0.3
    assert hidden.returncode == 1
    assert "not: 'tip' is not tracked" in hidden.stderr
    assert not rows(hidden)


def test_markers_by_name_and_a_multicast_group(tmp_path):
    setup_file(tmp_path, "contid_mocap: 1\nroom: {up: z}\nrobots: {arm: {marker: 'tip:Marker3'}}\n")
    data = free_port(socket.SOCK_DGRAM)
    group = ("--multicast", "239.255.42.99", "--data-port", str(data))
    with emulated_room("natnet", "tip=0,0,0.3", "--rate-hz", "100", *group) as room:
        alone = track(tmp_path, "natnet", room, "--print", "--for", "1")
        done = track(tmp_path, "natnet", room, "--print", "--for", "1.5", *group[:2])
    assert alone.returncode == 2
    assert "sends to the group 239.255.42.99: --multicast 239.255.42.99" in alone.stderr
    if not rows(done):
        pytest.skip("multicast does not reach this machine's loopback interface")
    assert all(float(row["z_mm"]) == pytest.approx(310.0, abs=1e-3) for row in rows(done))
    assert all(row["ax"] == "" for row in rows(done))


@pytest.mark.parametrize("block", ["256", "1024"])
def test_a_vicon_room_is_followed(tmp_path, block):
    setup_file(tmp_path, SETUP + "vicon: {rate_hz: 100}\n")
    others = [f"other{k}" for k in range(8)]
    with emulated_room("vicon", *others, "tip=0.1,0.2,0.3", "--block", block, "--rate-hz", "100") as room:
        done = track(tmp_path, "vicon", room, "--print", "--for", "1.5")
        listed = track(tmp_path, "vicon", room, "--list")
    assert done.returncode == 0, done.stderr
    assert "0 frames did not arrive" in done.stderr
    found = rows(done)
    assert len(found) > 50
    radii = [math.hypot(float(row["x_mm"]) - 100.0, float(row["y_mm"]) - 200.0) for row in found]
    assert radii == pytest.approx([20.0] * len(radii), abs=0.01)
    assert "body 'other7'" in listed.stdout


def test_a_vicon_object_that_is_held_or_lost_is_not_measured(tmp_path):
    setup_file(tmp_path, SETUP)
    with emulated_room("vicon", "tip", poses=True) as room:
        room.pose({"tip": None})
        done = track(tmp_path, "vicon", room, "--print", "--for", "1")
    assert done.returncode == 1
    assert "not: 'tip' is not tracked" in done.stderr


def test_names_are_listed_without_a_setup(tmp_path):
    with emulated_room("natnet", "tip=0.1,0,0", "plate") as room:
        done = track(tmp_path, "natnet", room, "--list")
    assert done.returncode == 0, done.stderr
    assert "body 'plate': x_mm" in done.stdout
    assert "marker 'tip:Marker1': x_mm" in done.stdout


def test_what_cannot_work_is_refused_with_its_remedy(tmp_path):
    setup_file(tmp_path, SETUP)
    silent = contid_in(
        tmp_path, "track", "natnet", *HERE, "--command-port", str(free_port(socket.SOCK_DGRAM)), "--print"
    )
    assert silent.returncode == 4
    assert "does not answer (Motive: Data Streaming on" in silent.stderr
    foreign = contid_in(
        tmp_path, "track", "vicon", "--server", "127.0.0.1", "--local", "203.0.113.7", "--print"
    )
    assert foreign.returncode == 4
    assert "--local is an address of this machine" in foreign.stderr
    named = contid_in(
        tmp_path, "track", "natnet", "--server", "motive.lab", "--local", "127.0.0.1", "--print"
    )
    assert named.returncode == 2
    assert "'motive.lab' is no IPv4 address" in named.stderr
    none = contid_in(tmp_path, "track", "natnet", *HERE, "--setup", "none.yaml")
    assert none.returncode == 2
    assert "none.yaml: cannot read it" in none.stderr
    with emulated_room("natnet", "tip", "--version", "3.1") as room:
        newer = track(tmp_path, "natnet", room, "--print", "--version", "4.1")
    assert newer.returncode == 2
    assert "the server at 127.0.0.1 has NatNet 3.1: leave --version out" in newer.stderr
    near = contid_in(tmp_path, "track", "natnt", *HERE)
    assert near.returncode == 2
    assert "Did you mean 'natnet'?" in near.stderr


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("natnet", "tip=1"), "'1' is not 3 numbers"),
        (("natnet", "tip=0,0,0", "base", "tip=1,1,1"), "'tip' is given twice"),
        (("natnet", "=1,2,3"), "'=1,2,3' has no name"),
        (("natnet", "--version", "5"), "'--version': '5' is not one of '3.0'"),
        (("natnet", "--rate-hz", "0"), "--rate-hz"),
        (("natnet", "--address", "203.0.113.7"), "--address is one of this machine"),
        (("vicon", "--block", "50"), "--block"),
    ],
)
def test_an_emulated_room_refuses_mistakes(tmp_path, arguments, expected):
    done = contid_in(tmp_path, "track", "emulate", *arguments)
    assert done.returncode == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr


def test_nothing_listens_but_one_socket_of_the_given_address(tmp_path):
    setup_file(tmp_path, SETUP)
    with emulated_room("natnet", "tip", "--rate-hz", "50") as room:
        tracker = started(tmp_path, room)
        assert tracker.stdout is not None
        for _ in range(3):
            assert tracker.stdout.readline()
        links = [
            link.readlink().name for link in Path(f"/proc/{tracker.pid}/fd").iterdir() if link.is_symlink()
        ]
        inodes = {link[8:-1] for link in links if link.startswith("socket:[")}
        bound = []
        for table in ("udp", "udp6", "tcp", "tcp6"):
            lines = Path(f"/proc/{tracker.pid}/net/{table}").read_text().splitlines()[1:]
            bound += [(table, line.split()[1]) for line in lines if line.split()[9] in inodes]
        tracker.send_signal(signal.SIGINT)
        output = tracker.communicate(timeout=60)
    assert [table for table, _ in bound] == ["udp"]
    assert bound[0][1].startswith("0100007F:")
    assert tracker.returncode == 130
    assert "poses measured" in output[1]


def test_a_server_that_starts_again_is_followed(tmp_path):
    setup_file(tmp_path, SETUP)
    with emulated_room("natnet", "tip", "--rate-hz", "100") as room:
        port = room.port
        tracker = started(tmp_path, room)
        assert tracker.stdout is not None
        for _ in range(20):
            assert tracker.stdout.readline()
        time.sleep(1.0)
    again = subprocess.Popen(
        [sys.executable, "-m", "contid", "track", "emulate", "natnet", "tip=0.3,0,0", "--port", str(port)],
        stderr=subprocess.DEVNULL,
    )
    try:
        end_s = time.monotonic() + 30.0
        row = ""
        while time.monotonic() < end_s and not (row.count(",") > 3 and float(row.split(",")[2]) > 250.0):
            row = tracker.stdout.readline()
        assert float(row.split(",")[2]) > 250.0
    finally:
        again.kill()
        again.wait(60)
        tracker.send_signal(signal.SIGINT)
        tracker.communicate(timeout=60)
