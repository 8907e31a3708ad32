"""The example driver of docs/devices/drivers.md, found by its entry point as if it were installed."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.ports import free_port

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent
WINCH = ROOT / "examples" / "winch"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the robot file, at a port that is free, and what ``pip install`` leaves of a driver."""
    port = free_port()
    text = (WINCH / "arm.yaml").read_text()
    assert "127.0.0.1:7070" in text
    (tmp_path / "arm.yaml").write_text(text.replace("127.0.0.1:7070", f"127.0.0.1:{port}"))
    metadata = tmp_path / "site" / "contid_winch-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: contid-winch\nVersion: 1.0\n")
    points = re.search(
        r'entry-points\."(contid\.drivers)"\]\n(\w+) = "(.*)"', (WINCH / "pyproject.toml").read_text()
    )
    assert points
    (metadata / "entry_points.txt").write_text(f"[{points[1]}]\n{points[2]} = {points[3]}\n")
    return tmp_path


def start(folder: Path, *message: str) -> subprocess.Popen[str]:
    path = [folder / "site", WINCH, ROOT, ROOT / "drivers"]
    return subprocess.Popen(
        [sys.executable, "-m", "contid", *message],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(str, path)), "XDG_RUNTIME_DIR": str(folder)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def contid(folder: Path, *message: str) -> str:
    with start(folder, *message) as process:
        out, errors = process.communicate(timeout=60)
    assert process.returncode == 0, out + errors
    return out


@pytest.fixture
def emulated(folder: Path) -> Iterator[Path]:
    """The same folder, with an emulated box at the port."""
    with start(folder, "emulate", "winch", "arm.yaml") as emulator:
        assert emulator.stderr is not None
        assert "ready" in emulator.stderr.readline()
        yield folder
        emulator.send_signal(signal.SIGINT)
        emulator.communicate(timeout=10)


def test_the_commands_know_the_driver(folder: Path) -> None:
    report = json.loads(contid(folder, "check", "--json", "arm.yaml"))
    assert [axis["address"] for axis in report["robots"][0]["axes"]] == ["drum 1", "drum 2", "drum 3"]
    assert report["buses"][0]["port"].startswith("127.0.0.1:")
    schema = json.loads(contid(folder, "schema"))
    titles = [each["title"] for each in schema["$defs"]["BusDescription"]["oneOf"]]
    assert "bus with driver winch" in titles


def test_a_mistake_in_its_keys_is_named_with_its_place(folder: Path) -> None:
    text = (folder / "arm.yaml").read_text()
    (folder / "bad.yaml").write_text(text.replace("drum: 2", "drum: 1").replace("drum: 3", "drumm: 3"))
    with start(folder, "check", "bad.yaml") as process:
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "drum 1 on bus 'box' already belongs to arm.s1.l1" in errors
    assert "'drumm'" in errors


@pytest.mark.realtime
def test_the_arm_follows_a_circle_on_the_emulated_box_and_the_recording_replays(emulated: Path) -> None:
    path = contid(
        emulated, "path", "circle", "--size", "60", "--height", "200", "--period", "2", "--for", "arm.yaml"
    )
    (emulated / "circle.csv").write_text(path)
    assert "the box answers" in contid(emulated, "doctor", "arm.yaml")
    options = ("--trajectory", "circle.csv", "--record", "circle.mcap", "--json")
    report = json.loads(contid(emulated, "run", "arm.yaml", *options))
    assert report["robots"]["arm"]["fault"] in (None, 0, "")
    assert "bit for bit" in contid(emulated, "replay", "circle.mcap")


def test_without_the_box_the_message_names_what_to_check(folder: Path) -> None:
    with start(folder, "run", "arm.yaml") as process:
        report, _ = process.communicate(timeout=60)
    assert process.returncode == 4
    assert "check that the box is on" in report


def test_it_runs_simulated_without_the_box(folder: Path) -> None:
    path = contid(folder, "path", "circle", "--size", "60", "--height", "200", "--for", "arm.yaml")
    (folder / "circle.csv").write_text(path)
    contid(folder, "run", "arm.yaml", "--virtual", "--trajectory", "circle.csv")
