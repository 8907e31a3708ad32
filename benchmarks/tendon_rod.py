"""Rod statics of a tendon robot: ``python benchmarks/tendon_rod.py [TARGETS]``.

`tendon3` with ``rod: {weight_n_per_m: [0.8]}``: solves of the rod, and targets along a path under a force on
the tip, each from the answer before as in the tick. The shortest of three calls counts.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from contid.kinematics.model import build_model
from contid.robot_file.load import find_robot_file, parse_robot_file
from contid.targets import Actuation, Target
from contid_tendons.loaded import LoadedTendonModel

TIMES: Final = 3
LOAD_N: Final = (0.02, 0.0, -0.05)


def loaded_model() -> LoadedTendonModel:
    """`tendon3` with the weight of its sections."""
    text = Path(find_robot_file("tendon3")).read_text(encoding="utf-8")
    text = text.replace("    rates:\n", "    rod: {weight_n_per_m: [0.8]}\n    rates:\n", 1)
    (robot,) = parse_robot_file(text, "tendon3.yaml").file.robots.values()
    model = build_model(robot)
    assert isinstance(model, LoadedTendonModel)
    return model


def shortest_us(call: Callable[[], object]) -> float:
    """Time of the shortest of three calls [us]."""
    times = []
    for _ in range(TIMES):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e6 * min(times)


def measured(count: int) -> tuple[Sequence[float], Sequence[float]]:
    """Times of solves of the rod and of targets [us]."""
    model = loaded_model()
    seed: Actuation = (0.0,) * 9
    solves, answers = [], []
    for k in range(count):
        angle = 0.01 * k
        target = Target(tip_m=(0.05 * np.cos(angle), 0.05 * np.sin(angle), 0.27), load_n=LOAD_N)
        answer = model.inverse(target, seed)
        if not answer.converged or answer.residual_m > 1e-6:
            raise RuntimeError(f"target {k}: {answer.note}")
        if k:  # the first one comes from the straight robot
            answers.append(shortest_us(partial(model.inverse, target, seed)))
            solves.append(shortest_us(partial(model.equilibrium, answer.actuation, LOAD_N)))
        seed = answer.actuation
    return solves, answers


def main() -> None:
    """See the module."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    solves, answers = measured(count)
    line = [f"{count - 1} targets:"]
    for what, times in (("rod", solves), ("target", answers)):
        median, p99 = np.percentile(times, [50, 99])
        line.append(f"{what} median {median:.0f} us, p99 {p99:.0f} us;")
    print(" ".join(line))


if __name__ == "__main__":
    main()
