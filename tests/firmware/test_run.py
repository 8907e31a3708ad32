"""`contid run` on a pty with the sketch's machine code behind it, slowed because the emulation is."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.firmware.sam3x.build import build_sketch

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
#: The shipped robot files at a tenth of their speed or less.
SLOWED = {"role: ": "latency_ms: 100\n    watchdog_ms: 1500\n    role: "}
TRIRACK = {
    "role: ": "latency_ms: 200\n    watchdog_ms: 2400\n    role: ",
    "rate_hz: 100": "rate_hz: 2.5",
    "velocity_mm_s: 100": "velocity_mm_s: 3",
    "acceleration_mm_s2: 900": "acceleration_mm_s2: 10",
    "jerk_mm_s3: 18000": "jerk_mm_s3: 50",
}
STIFFFLOP2 = {
    **SLOWED,
    "rate_hz: 500": "rate_hz: 5",
    # The emulated chip is slower than a real one on a machine that has other work.
    "tolerance_ticks: 25": "tolerance_ticks: 20",
    "    rates:": "    follow_lag_ms: 2000\n    rates:",
    "velocity_bar_s: 2.0": "velocity_bar_s: 0.1",
    "acceleration_bar_s2: 20.0": "acceleration_bar_s2: 0.5",
    "jerk_bar_s3: 400.0": "jerk_bar_s3: 5",
}
COUNTS_PER_MM = 4776 / 78.53981633974483
#: The robot stands at the last row for a while, where the machine may be late.
LENGTHS_MM = """\
t_s,s1.l1_mm,s1.l2_mm,s1.l3_mm
0,50,50,50
1.5,51.5,51.5,51.5
3,50.5,51,51.5
3.8,50.5,51,51.5
"""
MIDWAY_BAR, LAST_BAR = (0.4, 0.3, 0.2, 0.1, 0.35, 0.25), (0.3, 0.3, 0.25, 0.2, 0.1, 0.4)
PRESSURES_BAR = "\n".join(
    (
        "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar,s2.p1_bar,s2.p2_bar,s2.p3_bar",
        "0,0,0,0,0,0,0",
        ",".join(map(str, (8, *MIDWAY_BAR))),
        ",".join(map(str, (13, *LAST_BAR))),
        "",
    )
)


def elf(name: str) -> Path:
    if name == "ziglang":
        return build_sketch()
    given = os.environ.get("CONTID_DUE_ELF")
    if given is None:
        pytest.skip("CONTID_DUE_ELF names no ELF file of the sketch")
    return Path(given)


def run(
    folder: Path, name: str, port: str, changes: Mapping[str, str], rows: str, *board_options: str
) -> dict[str, Any]:
    """Run the rows on a slowed copy of configs/NAME.yaml; what the board's server prints at its end."""
    text = (ROOT / "configs" / f"{name}.yaml").read_text()
    for full_speed, slowed in changes.items():
        assert full_speed in text
        text = text.replace(full_speed, slowed)
    (folder / "slow.yaml").write_text(text)
    (folder / "rows.csv").write_text(rows)
    serve = [sys.executable, "-m", "tests.firmware.sam3x.serve", str(folder / port), *board_options]
    board = subprocess.Popen(serve, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert board.stdout is not None
    try:
        assert board.stdout.readline() == "ready\n"
        command = [sys.executable, "-m", "contid", "run", "slow.yaml", "--trajectory", "rows.csv"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    finally:
        board.send_signal(signal.SIGTERM)
        last, _ = board.communicate(timeout=30)
    assert done.returncode == 0, done.stdout + done.stderr
    figures: dict[str, Any] = json.loads(last)
    assert figures["resets"] == 0
    return figures


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.parametrize("name", ["ziglang", "flashed"])
def test_trirack_follows_its_rows(tmp_path: Path, name: str):
    board = str(elf(name))
    figures = run(tmp_path, "trirack.emulated", "trirack.tty", TRIRACK, LENGTHS_MM, board)
    for shaft, millimetres in zip(figures["shaft"], (0.5, 1, 1.5), strict=False):
        assert shaft == pytest.approx(millimetres * COUNTS_PER_MM, abs=8)


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.campaign  # in CI the pressure board's machine code runs in test_dead_man, such runs in wire/due
@pytest.mark.parametrize("name", ["ziglang", "flashed"])
def test_stiffflop2_follows_its_rows(tmp_path: Path, name: str):
    given = (str(elf(name)), "--pressure")
    port = "stiffflop2-regulators.tty"
    figures = run(tmp_path, "stiffflop2.emulated", port, STIFFFLOP2, PRESSURES_BAR, *given)
    # The command has 12 bits (0.7 mbar), the reading of 1/4096 of 3.17 bar as much.
    assert figures["bar"] == pytest.approx(LAST_BAR, abs=0.005)
    for highest, *rows in zip(figures["highest_bar"], MIDWAY_BAR, LAST_BAR, strict=True):
        assert max(rows) - 0.01 < highest < max(rows) + 0.05
