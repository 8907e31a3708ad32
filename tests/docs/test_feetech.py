"""The example of docs/devices/drivers.md that is built with the kit: tested as its authors would, and run."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from contid_feetech.emulator import FeetechEmulator, Servo
from tests.support.waiting import until

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent.parent
FEETECH = ROOT / "examples" / "feetech"
PORT = "/dev/serial/by-id/usb-1a86_USB_Single_Serial_XXXXXXXX-if00"
#: Emulated servos do not run in real time as the tick does: a late answer is taken, and costs the next tick.
TOLERANT = "tolerance_ticks: 50\n    latency_ms: 100"
#: Lines of the driver without its emulator, which docs/devices/drivers.md states.
LINES = 252


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the robot file, at a port of its own, and what ``pip install`` leaves of a driver."""
    text = (FEETECH / "arm.yaml").read_text()
    assert PORT in text
    patient = text.replace("rate_hz: 100", "rate_hz: 50").replace("tolerance_ticks: 5  # 50 ms", TOLERANT)
    (tmp_path / "arm.yaml").write_text(patient.replace(PORT, str(tmp_path / "servos")))
    metadata = tmp_path / "site" / "contid_feetech-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: contid-feetech\nVersion: 1.0\n")
    points = re.search(
        r'entry-points\."(contid\.drivers)"\]\n(\w+) = "(.*)"', (FEETECH / "pyproject.toml").read_text()
    )
    assert points
    (metadata / "entry_points.txt").write_text(f"[{points[1]}]\n{points[2]} = {points[3]}\n")
    return tmp_path


@pytest.fixture
def servos(folder: Path) -> Iterator[dict[int, Servo]]:
    """Three emulated servos at the port of the file, inside its limits."""
    with FeetechEmulator(str(folder / "servos"), [Servo(each, "sts", 2200.0) for each in (1, 2, 3)]) as made:
        yield made.servos


def start(folder: Path, *message: str, stdin: int = subprocess.DEVNULL) -> subprocess.Popen[str]:
    path = [folder / "site", FEETECH, ROOT, ROOT / "drivers"]
    return subprocess.Popen(
        [sys.executable, "-m", *message],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, path)),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # plain pytest
            "XDG_RUNTIME_DIR": str(folder),
        },
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def output(folder: Path, *message: str, code: int = 0) -> str:
    with start(folder, *message) as process:
        out, _ = process.communicate(timeout=150)
    assert process.returncode == code, out
    return out


def test_the_driver_has_as_few_lines_as_the_page_states() -> None:
    files = [path for path in (FEETECH / "contid_feetech").glob("*.py") if path.name != "emulator.py"]
    assert 0 < sum(len(path.read_text().splitlines()) for path in files) <= LINES


@pytest.mark.realtime
def test_its_own_pytest_runs_the_contract_without_a_checkout_of_contid(folder: Path) -> None:
    """As its authors do: their configuration, none of the plug-ins and marks of contid's own tests.

    The whole contract of this driver runs in tests/contract.
    """
    (folder / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\nfilterwarnings = error\n")
    (folder / "test_own.py").write_text((FEETECH / "test_feetech.py").read_text())
    chosen = "TestSts and (enable or watchdog) or sdk or opening or reset"
    options = ("-q", "-p", "no:cacheprovider", "-k", chosen)
    report = output(folder, "pytest", *options, "test_own.py")
    assert re.search(r"\n\d+ passed, \d+ skipped, \d+ deselected in", report), report


def test_check_names_the_missing_watchdog(folder: Path) -> None:
    report = output(folder, "contid", "check", "arm.yaml")
    assert "servos: its devices have no watchdog" in report
    assert "relay that drops out" in report
    (folder / "bad.yaml").write_text((folder / "arm.yaml").read_text().replace("id: 2", "id: 1"))
    assert "id 1 on bus 'servos' already belongs to" in output(folder, "contid", "check", "bad.yaml", code=2)


def test_a_driver_that_cannot_be_imported_is_named_with_its_place(folder: Path) -> None:
    points = folder / "site" / "contid_feetech-1.0.dist-info" / "entry_points.txt"
    points.write_text(points.read_text().replace("contid_feetech:", "contid_feetech_gone:"))
    report = output(folder, "contid", "check", "arm.yaml", code=2)
    assert "arm.yaml:8:13: driver 'feetech' cannot be imported from contid_feetech_gone:DRIVER" in report
    assert "No module named 'contid_feetech_gone'; install its package again" in report


@pytest.mark.realtime
def test_the_arm_follows_a_circle_on_emulated_servos(folder: Path, servos: dict[int, Servo]) -> None:
    assert "50 of 50 answers" in output(folder, "contid", "doctor", "arm.yaml")
    # So slow that a servo whose process waits for a processor for a tenth of a second is not off its command.
    circle = ("--size", "60", "--height", "150", "--period", "8", "--for", "arm.yaml")
    (folder / "circle.csv").write_text(output(folder, "contid", "path", "circle", *circle))
    report = json.loads(
        output(folder, "contid", "run", "arm.yaml", "--trajectory", "circle.csv", "--json").splitlines()[-1]
    )
    assert report["robots"]["arm"]["fault"] in (None, 0, "")
    assert {servo.memory[40] for servo in servos.values()} == {1}  # stop.on_end: hold


@pytest.mark.realtime
def test_without_the_servos_the_message_names_them(folder: Path) -> None:
    with FeetechEmulator(str(folder / "servos"), [Servo(2, "sts", 2200.0)]):
        report = output(folder, "contid", "run", "arm.yaml", code=4)
    assert "no answer from arm.s1.l1 (id 1); no answer from arm.s1.l3 (id 3)" in report


@pytest.mark.realtime
def test_a_killed_control_process_leaves_no_servo_under_torque(
    folder: Path, servos: dict[int, Servo]
) -> None:
    """Servos have no watchdog: the process of the bus applies on_host_loss."""
    with start(folder, "contid", "run", "arm.yaml", "--on-end", "hold", stdin=subprocess.PIPE) as daemon:
        try:
            assert daemon.stdin is not None
            daemon.stdin.write("s1.l1_mm,s1.l2_mm,s1.l3_mm\n150,150,150\n")
            daemon.stdin.flush()
            until(lambda: {servo.memory[40] for servo in servos.values()} == {1}, "all have torque")
            children = psutil.Process(daemon.pid).children()
            (control,) = (each for each in children if "contid.control.process" in each.cmdline())
            os.kill(control.pid, signal.SIGKILL)
            until(lambda: not any(servo.memory[40] for servo in servos.values()), "none has torque", 20.0)
            daemon.communicate(timeout=20)
        finally:
            daemon.kill()  # it holds, whatever its input does
