"""`contid run` on a pty with the sketch's machine code behind it, slowed because the emulation is."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.firmware.sam3x.build import build_sketch

ROOT = Path(__file__).parents[2]
#: trirack.emulated at a tenth of its speed or less.
SLOWED = {
    "rate_hz: 100": "rate_hz: 20",
    "role: motor": "role: motor\n    latency_ms: 25\n    watchdog_ms: 300",
    "velocity_mm_s: 100": "velocity_mm_s: 3",
    "acceleration_mm_s2: 900": "acceleration_mm_s2: 10",
    "jerk_mm_s3: 18000": "jerk_mm_s3: 50",
}
ROWS = "t_s,s1.l1_mm,s1.l2_mm,s1.l3_mm\n0,50,50,50\n3,53,53,53\n6,51,52,53\n"
COUNTS_PER_MM = 4776 / 78.53981633974483


def elf(name: str) -> Path:
    if name == "ziglang":
        return build_sketch()
    given = os.environ.get("CONTID_DUE_ELF")
    if given is None:
        pytest.skip("CONTID_DUE_ELF names no ELF file of the sketch")
    return Path(given)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("name", ["ziglang", "flashed"])
def test_trirack_follows_its_rows(tmp_path: Path, name: str):
    text = (ROOT / "configs" / "trirack.emulated.yaml").read_text()
    for full_speed, slowed in SLOWED.items():
        assert full_speed in text
        text = text.replace(full_speed, slowed)
    (tmp_path / "slow.yaml").write_text(text)
    (tmp_path / "rows.csv").write_text(ROWS)
    command = [
        sys.executable,
        "-m",
        "tests.firmware.sam3x.serve",
        str(tmp_path / "trirack.tty"),
        str(elf(name)),
    ]
    board = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert board.stdout is not None
    try:
        assert board.stdout.readline() == "ready\n"
        run = [sys.executable, "-m", "contid", "run", "slow.yaml", "--trajectory", "rows.csv"]
        done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    finally:
        board.send_signal(signal.SIGTERM)
        last, _ = board.communicate(timeout=30)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(last)
    assert figures["resets"] == 0
    for shaft, millimetres in zip(figures["shaft"], (1, 2, 3), strict=False):
        assert shaft == pytest.approx(millimetres * COUNTS_PER_MM, abs=8)
