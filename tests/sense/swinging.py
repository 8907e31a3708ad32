"""False contacts of an arm that swings: the detector beside the moving twin of `contid_dynamics.body`.

The plant has the errors of `tests.sense.observed`, and every arm its own calibration, of poses at rest.
Pressures go to random places in 0.3 to 1.2 s, and stay there for 0.5 to 4 s.

    python -m tests.sense.swinging [MINUTES] [ARMS]
"""

from __future__ import annotations

import sys

import numpy as np

from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid_dynamics.body import MovingBody
from tests.sense.contact_runs import ContactRun
from tests.sense.observed import ERRORS, RATE_HZ, calibrated, plant
from tests.sense.plant import shipped_robot


class SwingingArm:
    """The moving twin with the calls of a body at rest; a call of `follow` is a tick."""

    def __init__(self) -> None:
        sim = SimulatedArm(errors=ERRORS, dynamics=True)
        self._body = MovingBody(shipped_robot().model_copy(update={"sim": sim}))
        self._ticks = 0

    def follow(self, pressures_pa: list[float]) -> None:
        self._body.follow(pressures_pa, self._ticks / RATE_HZ)
        self._ticks += 1

    def tip_in_world_m(self, t_s: float) -> tuple[float, float, float]:
        return self._body.tip_in_world_m(t_s)


def swings(seed: int, minutes: float) -> tuple[int, float, float]:
    """Contacts that are none, share of the time that the detector looked, largest squared distance."""
    rng = np.random.default_rng(5000 + seed)
    robot = calibrated(plant(), rng)
    assert robot.sense is not None
    load = robot.sense.load.model_copy(update={"swings": True})
    robot = robot.model_copy(update={"sense": robot.sense.model_copy(update={"load": load})})
    run = ContactRun(robot, SwingingArm(), rng)
    run.begin(rng.uniform(0.1, 0.9, 6))
    began, looked, largest = run.ticks, 0, 0.0
    while run.ticks - began < 60.0 * minutes * RATE_HZ:
        start, goal = run.bar, rng.uniform(0.05, 1.0, 6)
        moving, resting = (round(RATE_HZ * rng.uniform(*each)) for each in ((0.3, 1.2), (0.5, 4.0)))
        for k in range(1, moving + resting + 1):
            s = min(1.0, k / moving)
            run.tick(start + (goal - start) * (3.0 * s * s - 2.0 * s**3))
            if run.contact.armed:
                looked, largest = looked + 1, max(largest, run.contact.distance)
    return len(run.contacts), looked / (run.ticks - began), largest


if __name__ == "__main__":
    given = [float(each) for each in sys.argv[1:]]
    minutes, arms = (*given, *(60.0, 12.0)[len(given) :])
    false = 0
    for seed in range(int(arms)):
        found, looked, largest = swings(seed, minutes / arms)
        false += found
        print(f"arm {seed}: {found} false contacts, looked {100 * looked:.0f} %, greatest {largest:.1f}")
    print(f"{minutes:g} simulated minutes of swinging: {false} false contacts")
