"""Random moves of tendons with load cells: ``python -m tests.firmware.tendons.trials [MOVES]``.

A trial is two channels of the linked core, their host, and two tendons (cable.h): 0.7 to 2.5 N/mm on either
side of a capstan whose friction holds up to 2.2 times the tension, bodies that move at up to 40 mm/s while
the host demands something else, cells with noise of 3 to 15 mN. At a cell behind a converter bodies move at
4 mm/s at most.
"""

from __future__ import annotations

import argparse
import random
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from contid.hal import AxisOnBus
from contid_drivers.due import wiring
from contid_drivers.due.codes import BoardState, Reason
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.shafts.linked_core import build_with_core

HERE = Path(__file__).parent
#: Moves of one trial, each of both tendons for a second.
MOVES = 50
MM_PER_DEG = 78.53981633974483 / 360.0
AMPLIFIER = {
    "readings": [[200.0, 0.0], [3100.0, 50.0]],
    "floor_n": 1.0,
    "ceiling_n": 45.0,
    "take_up_deg": 60.0,
}
CONVERTER = {
    **AMPLIFIER,
    "cell": "converter",
    "readings": [[100_000, 0.0], [4_100_000, 50.0]],
    "rate_hz": 80,
}


@dataclass(frozen=True)
class Trial:
    """What came of one trial.

    Attributes:
        ms: from the failure to the safe state; -1 when it came to none.
        least_n: least tension in the moves.
        below: moves with a tension below the floor by more than 0.1 N.
        outward: greatest outward duty after the failure, of 1.
        tension_n: at the end.
        line: what was asked of the program; it repeats the trial.
    """

    reason: Reason
    state: BoardState
    ms: int
    least_n: float
    below: int
    outward: float
    tension_n: float
    line: str


def program() -> Path:
    """The trials' program with the core linked in."""
    included = [HERE / "cable.h", HERE.parent / "shafts" / "shaft.h"]
    return build_with_core("tendons", HERE / "main.cpp", included)


def configure(tightens: int, hz: int, stiffness_n_per_mm: float) -> str:
    """The body of a configure message for two motors, in hex."""
    keys: dict[str, Any] = CONVERTER | {"rate_hz": hz} if hz else AMPLIFIER
    keys = keys | {"tightens": tightens, "stiffness_n_per_deg": stiffness_n_per_mm * MM_PER_DEG}
    axes = [
        AxisOnBus(name, DueAxisOptions.model_validate(
            {"channel": name, "start_state": "brake", "follow_deg": 90.0, "acceleration_deg_s2": 4600.0,
             "tension": keys}
        ), None)
        for name in ("m0", "m1")
    ]  # fmt: skip
    blob = wiring.board_config("board", DueBusOptions(port="x", role=Role.MOTOR), axes)
    return wiring.config_body(blob).hex()


def run(kind: str, trials: int, moves: int = 3, hz: int = 0, seed: int = 1) -> list[Trial]:
    """Run random trials, each with other tendons and motions."""
    rng = random.Random(f"{kind} {hz} {seed}")
    asked = []
    for _ in range(trials):
        tightens, near = rng.choice((1, -1)), rng.uniform(0.7, 2.5)
        body = configure(tightens, hz, near * rng.uniform(1.0, 1.3))
        asked.append(f"{kind} {rng.randrange(1 << 30)} {moves} {hz} {tightens} {near:.3f} {body}")
    return repeat(asked)


def repeat(asked: list[str]) -> list[Trial]:
    """Run the trials of given lines."""
    done = subprocess.run(
        [program()], input="\n".join(asked) + "\n", capture_output=True, text=True, check=True
    )
    return [
        _trial(line, *answer.split()) for line, answer in zip(asked, done.stdout.splitlines(), strict=True)
    ]


def _trial(
    line: str, reason: str, state: str, ms: str, least: str, below: str, outward: str, tension: str
) -> Trial:
    return Trial(
        Reason(int(reason)), BoardState(int(state)), int(ms), float(least), int(below), float(outward),
        float(tension), line,
    )  # fmt: skip


KINDS = ("cut", "loosened", "open", "saturated", "frozen", "reversed", "swapped", "silent", "host")

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("moves", type=int, nargs="?", default=100_000)
    parser.add_argument("--hz", type=int, default=0)
    parser.add_argument("--trials", type=int, default=100)
    given = parser.parse_args()
    done = run("moves", max(1, given.moves // (2 * MOVES)), MOVES, given.hz)
    count = 2 * MOVES * len(done)
    worst = min(done, key=lambda one: one.least_n)
    print(f"{count} moves of tendons: least {worst.least_n:.3f} N at a floor of 1 N,",
          f"{sum(one.below for one in done)} seconds below 0.9 N,",
          f"{sum(one.reason is not Reason.NONE for one in done)} faults")  # fmt: skip
    print("  worst:", worst.line[:60], [one.reason.name for one in done if one.reason][:5])
    for kind in KINDS if given.trials else ():
        done = run(kind, given.trials, 3 if kind != "swapped" else 20, given.hz)
        times = sorted(one.ms for one in done)
        reasons = sorted({one.reason.name for one in done})
        print(f"{kind}: {reasons}, ms {times[0]} {times[len(times) // 2]} {times[-1]},",
              f"outward {max(one.outward for one in done):.3f},",
              f"least {min(one.least_n for one in done):.3f},",
              f"tension at the end {min(one.tension_n for one in done):.3f}")  # fmt: skip
