"""Random trials of the boards' encoder watch: ``python -m tests.firmware.shafts.trials [TRIALS]``.

A trial is one channel of the linked core, its host, and a geared motor within rating (shaft.h): friction 2
to 30 %, time constant 10 to 160 ms, speed within 20 % and supply within 10 % of the file's, loads up to the
file's ``stall_percent``, play. Motors whose encoder breaks have gears that hold their load; none has a
current sensor.
"""

from __future__ import annotations

import argparse
import random
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from contid.hal import AxisOnBus
from contid_drivers.due import wiring
from contid_drivers.due.codes import BoardState, Reason
from contid_drivers.due.options import DueAxisOptions, DueBusOptions, Role
from tests.firmware.shafts.linked_core import build_with_core

HERE = Path(__file__).parent
#: Counts per degree of the default gear.
DEGREE = 4776 / 360.0
FAULTS = ("dead", "track_a", "track_b", "reversed")
SPEED_DEG_S = (3.0, 300.0)
SLOW_DEG_S = 30.0
Mode = Literal["armed", "homing", "healthy"]


@dataclass(frozen=True)
class Trial:
    """One trial: what was demanded, and what came of it.

    Attributes:
        speed_deg_s: demanded speed, or that of homing.
        reason, state: of the channel at the end.
        ms: from the onset of the fault to the safe state; -1 when it came to none.
        at_fault_deg, at_rest_deg: farthest place from that of the onset until the safe state, and until the
            shaft rested.
        line: what was asked of the program; it repeats the trial.
    """

    speed_deg_s: float
    reason: Reason
    state: BoardState
    ms: int
    at_fault_deg: float
    at_rest_deg: float
    line: str

    @property
    def limit_deg(self) -> float:
        """How far this trial may go: issue 45."""
        return 15.0 if self.speed_deg_s >= SLOW_DEG_S else 30.0


def program() -> Path:
    """The trials' program with the core linked in."""
    return build_with_core("shafts", HERE / "main.cpp", [HERE / "shaft.h"])


def configure(**options: Any) -> str:
    """The body of a configure message for one motor, in hex."""
    axis = AxisOnBus("m0", DueAxisOptions.model_validate({"channel": "m0", **options}), None)
    blob = wiring.board_config("board", DueBusOptions(port="x", role=Role.MOTOR), [axis])
    return wiring.config_body(blob).hex()


def run(mode: Mode, fault: str, trials: int, seed: int = 1) -> list[Trial]:
    """Run random trials, each with another motor, motion and moment of the fault."""
    rng = random.Random(f"{mode} {fault} {seed}")
    slow, fast = SPEED_DEG_S
    plain = configure()
    speeds, asked = [], []
    for _ in range(trials):
        speed, play_deg, body = slow * (fast / slow) ** rng.random(), 0.16, plain
        if mode == "homing":
            duty = rng.choice((25, 30, 40))
            body = configure(homing={"direction": 1, "speed_deg_s": speed, "duty_percent": duty})
        elif mode == "healthy":
            speed, play_deg = (
                rng.choice((30.0, 100.0, 200.0, 300.0, 460.0)),
                rng.choice((0.16, 0.16, 0.5, 1.0)),
            )
            body = configure(velocity_deg_s=speed, deadband_deg=play_deg)
        speeds.append(speed)
        numbers = f"{rng.randrange(1 << 30)} {speed * DEGREE:.1f} {play_deg * DEGREE:.2f}"
        asked.append(f"{mode} {fault} {numbers} {body}")
    done = subprocess.run(
        [program()], input="\n".join(asked) + "\n", capture_output=True, text=True, check=True
    )
    return [
        _trial(speed, line, answer.split())
        for speed, line, answer in zip(speeds, asked, done.stdout.splitlines(), strict=True)
    ]


def _trial(speed_deg_s: float, line: str, answer: Sequence[str]) -> Trial:
    reason, state, ms, at_fault, at_rest, _ = answer
    return Trial(
        speed_deg_s,
        Reason(int(reason)),
        BoardState(int(state)),
        int(ms),
        float(at_fault) / DEGREE,
        float(at_rest) / DEGREE,
        line,
    )


def share(values: Sequence[float], part: float) -> float:
    """The value that this part of all is not above."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


def table(trials: int) -> str:
    """Rows of figures: median, 99 % and greatest way, and false alarms."""
    rows = []
    modes: tuple[Mode, ...] = ("armed", "homing")
    for mode in modes:
        for fault in FAULTS:
            done = run(mode, fault, trials)
            for slow in (True, False):
                some = [one for one in done if (one.speed_deg_s < SLOW_DEG_S) == slow]
                at_fault = [one.at_fault_deg for one in some]
                at_rest = [one.at_rest_deg for one in some]
                figures = " / ".join(
                    f"{share(values, 0.5):.1f}, {share(values, 0.99):.1f}, {max(values):.1f}"
                    for values in (at_fault, at_rest)
                )
                above = sum(one.at_fault_deg > one.limit_deg for one in some)
                speed = "below 30" if slow else "from 30"
                missed = sum(one.reason is Reason.NONE and one.state is BoardState.ARMED for one in some)
                rows.append(
                    f"{mode} {fault} {speed} deg/s: {figures}; {above} above, {missed} unseen of {len(some)}"
                )
    whole: tuple[Mode, ...] = ("homing", "healthy")
    for mode in whole:
        done = run(mode, "none", 3 * trials)
        false = [one for one in done if one.reason is not Reason.NONE]
        rows.append(f"{mode} none: {len(false)} faults of {len(done)}")
        rows += [f"  {one.reason.name} {one.line}" for one in false[:5]]
    return "\n".join(rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("trials", type=int, nargs="?", default=1000)
    print(table(parser.parse_args().trials))
