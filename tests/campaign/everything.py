"""All campaigns for a time, in one table: ``python -m tests.campaign --all --minutes N``.

Each part runs in a process of its own, a slice of cases with a new seed at a time; the part with the least
time so far is next, so every part gets the same share. A slice that was begun is finished; Ctrl-C prints the
table so far. A violation ends with its output and the command that repeats it.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.campaign.bad_input import SOCKET, TARGETS

ROOT: Final = Path(__file__).parents[2]
#: A slice that takes longer than this has hung.
SLICE_S: Final = 900.0
#: Lines of the output of a slice with a violation.
TAIL: Final = 40


@dataclass
class Part:
    """One campaign.

    Attributes:
        name: in the table.
        command: of a slice, after the interpreter; ``{seed}`` is replaced.
        cases: of a slice.
        slices: done so far.
        seconds: used so far.
        failed: commands of slices with violations.
    """

    name: str
    command: str
    cases: int
    slices: int = 0
    seconds: float = 0.0
    failed: int = 0

    def run(self, seed: int) -> str:
        """One slice; what it printed if something was violated, else ""."""
        command = [sys.executable, *self.command.format(seed=seed).split()]
        begin_s = time.monotonic()
        try:
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, timeout=SLICE_S, check=False
            )
            output, code = done.stdout + done.stderr, done.returncode
        except subprocess.TimeoutExpired:
            output, code = f"no end within {SLICE_S:g} s", 1
        self.seconds += time.monotonic() - begin_s
        self.slices += 1
        if code == 0:
            return ""
        self.failed += 1
        return "\n".join([f"$ python {' '.join(command[1:])}", *output.splitlines()[-TAIL:]])


def parts() -> list[Part]:
    """Every campaign, in slices of at most about a minute."""
    command = "-m tests.campaign.bad_input --rounds 300 --seed {seed} --target"
    inputs = [Part(f"input: {name}", f"{command} {name}", 300) for name in (*TARGETS, SOCKET)]
    return [
        Part("motion and faults", "-m tests.campaign --cases 60 --seed {seed}", 60),
        Part("faults of emulated devices", "-m tests.campaign --ptys 10 --seed {seed}", 10),
        Part("SIGTERM in every state", "-m tests.campaign.exits --rounds 1 --seed {seed}", 16),
        Part("stops beside floods", "-m tests.campaign.stops --rounds 50 --seed {seed}", 50),
        Part("kills, suspensions, starvation", "-m tests.campaign.disturbances --rounds 1 --seed {seed}", 14),
        Part("core of the firmware", "firmware/fuzz.py 1000000 {seed}", 1_000_000),
        *inputs,
    ]


def everything(minutes: float, seed: int, among: Sequence[Part] | None = None) -> int:
    """Run for a time and print the table; the number of slices with violations."""
    end_s = time.monotonic() + 60.0 * minutes
    every, outputs = list(parts() if among is None else among), []
    try:
        while any(part.slices == 0 for part in every) or time.monotonic() < end_s:
            part = min(every, key=lambda each: each.seconds)
            if output := part.run(seed + part.slices):
                outputs.append(output)
    except KeyboardInterrupt:
        missing = ", ".join(part.name for part in every if part.slices == 0)
        outputs.append("interrupted" + (f"; not tried: {missing}" if missing else ""))
    print(f"{'campaign':<30}{'cases':>12}{'seconds':>10}{'violated slices':>17}")
    for part in every:
        print(f"{part.name:<30}{part.slices * part.cases:>12}{part.seconds:>10.0f}{part.failed:>17}")
    print(*outputs, sep="\n\n", end="\n" if outputs else "")
    return len(outputs)
