"""Loads on the tip of the two-section pneumatic arm, estimated in the tick: errors, intervals, alarms, times.

The plant is `tests.sense.observed.Loaded`: literal equations, moduli wrong by +4 and -3 %, moments by
-2 %, regulators off by up to 0.03 bar, hysteresis loops of 0.03 bar, tracker noise 0.3 mm at 50 Hz.

    python -m tests.sense.figures [ARMS] [SPIRAL_MINUTES] [FIRST_SEED]
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from contid.control.engine.virtual import VirtualProcess
from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.load import load_named, with_mock
from contid.robot_file.pneumatic.simulated import SimulatedArm
from tests.sense.observed import ERRORS, GRAM_N, RATE_HZ, Loaded, Run, calibrated, plant
from tests.sense.plant import shipped_robot

LOADS = 20


def static_loads(arms, first=0):
    """Loads put on resting arms; errors 1 s later, jumps while they move."""
    errors, shares, settled = [], [], []
    for seed in range(first, first + arms):
        rng, body = np.random.default_rng(seed), plant()
        run = Run(calibrated(body, rng), body, rng)
        run.move(rng.uniform(0.05, 1.2, 6))
        for _ in range(LOADS):
            share, load = run.put_on()
            shares.append(share)
            near = []
            for _ in range(round(RATE_HZ)):
                run.tick(run.bar)
                force, sigma = run.found()
                near.append(bool((np.abs(force - load) <= [0.6 * GRAM_N, 0.6 * GRAM_N, GRAM_N]).all()))
            settled.append((len(near) - near[::-1].index(False)) / RATE_HZ if False in near else 0.0)
            errors.append((force - load) / GRAM_N)
            shares.append((force - load) / sigma)
    rmse = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    held = np.abs(np.array(shares)) <= 1.96
    print(
        f"{len(errors)} loads of 0 to 10 g and up to 2 g sideways on {arms} arms, 1 s after they were put on:"
    )
    print(f"  RMS error [g]: sideways {rmse[0]:.3f} and {rmse[1]:.3f}, along gravity {rmse[2]:.3f}")
    print(f"  95 % intervals that hold the truth: {100.0 * held.mean():.1f} % of {held.size} components")
    late = np.quantile(settled, 0.95)
    print(f"  within 0.6 g sideways and 1 g along gravity for good: 95 % of loads after {late:.2f} s")


def spirals(minutes):
    """Unloaded arms on spirals: jumps that are none."""
    rng, body = np.random.default_rng(100), plant()
    changes, _ = on_spirals(Run(calibrated(body, rng), body, rng), minutes)
    print(f"spirals of 4 s a turn for {minutes:g} simulated minutes: {len(changes)} jumps of the estimate, "
          f"{sum(change > 1.0 for change in changes)} by more than 1 g")  # fmt: skip


def on_spirals(run, minutes):
    """By how much the estimate jumps, and what it is in each tick [g], on pressures that go round."""
    phases = np.array([0.0, 2.0, 4.0, 1.0, 3.0, 5.0]) * math.pi / 3.0
    run.move(0.6 + 0.1 * np.sin(phases))
    changes, found = [], []
    for k in range(round(60.0 * minutes * RATE_HZ)):
        before, t = run.observer.found, k / RATE_HZ
        radius = 0.1 + 0.3 * 0.5 * (1.0 - math.cos(2.0 * math.pi * t / 40.0))
        run.tick(0.6 + radius * np.sin(2.0 * math.pi * t / 4.0 + phases))
        after = run.observer.found
        if after:
            found.append(math.hypot(*after.force_in_base) / GRAM_N)
        if before and after and before.settled and not after.settled:
            changes.append(math.dist(after.force_in_base, before.force_in_base) / GRAM_N)
    return changes, found


def walls(count):
    """Arms that bend against a wall: from the onset of the push to the jump."""
    delays, missed = [], 0
    for seed in range(count):
        rng = np.random.default_rng(200 + seed)
        free = plant()
        robot = calibrated(free, rng)
        low, high = np.full(6, 0.3), np.array([1.0, 0.2, 0.2, 1.0, 0.2, 0.2])
        tips = []
        for bar in (low, 0.5 * (low + high)):
            free.follow((bar * 1e5).tolist())
            tips.append(np.array(free.tip_in_world_m(0.0)))
        way = (tips[1] - tips[0]) * [1.0, 1.0, 0.0]
        wall = PlaneDescription(
            point_mm=(1e3 * tips[1]).tolist(), normal=(-way / np.linalg.norm(way)).tolist()
        )
        sim = SimulatedArm(errors=ERRORS, wall=wall)
        body = Loaded(shipped_robot().model_copy(update={"sim": sim}))
        body.follow([0.0] * 6)
        body.tip_in_world_m(0.0)
        run = Run(robot, body, rng)
        run.move(low)
        run.rest(1.0)
        onset_s = None
        for k in range(round(3.0 * RATE_HZ)):
            run.tick(low + (high - low) * k / (3.0 * RATE_HZ))
            body.tip_in_world_m(0.0)
            if onset_s is None and body.push_n > 0.0:
                onset_s = run.ticks / RATE_HZ
            if onset_s is not None and (found := run.observer.found) is not None and not found.settled:
                delays.append(run.ticks / RATE_HZ - onset_s)
                break
        else:
            missed += 1
    shown = (
        f"median {1e3 * np.median(delays):.0f} ms, greatest {1e3 * max(delays):.0f} ms" if delays else "none"
    )
    print(f"{count} contacts with a wall at 0.2 bar/s: jump after {shown}; {missed} not seen")


def times():
    """Processor time of whole ticks of one robot file, with and without `sense`."""
    rng, body = np.random.default_rng(1), plant()
    robot = calibrated(body, rng)
    loaded = with_mock(load_named("stiffflop2"))
    bare = robot.model_copy(update={"sense": None, "sim": SimulatedArm(errors=ERRORS)})
    found = {}
    for name, arm in (("bare", bare), ("with sense", bare.model_copy(update={"sense": robot.sense}))):
        loaded.file.robots["arm"] = arm
        process = VirtualProcess(loaded, 500.0, _Nothing())
        process.engine.arm()
        spent = []
        for _ in range(6000):
            process.begin()
            begin = time.perf_counter_ns()
            process.turn()
            spent.append((time.perf_counter_ns() - begin) / 1e3)
        process.close()
        found[name] = np.percentile(spent[1000:], [50, 99])
    p50, p99 = found["with sense"] - found["bare"]
    print(f"a tick of 500 Hz, simulated devices and plant included: bare p50 {found['bare'][0]:.0f} us, "
          f"p99 {found['bare'][1]:.0f} us; with sense {p50:.0f} us and {p99:.0f} us more "
          f"({found['with sense'][0] / found['bare'][0]:.2f} and "
          f"{found['with sense'][1] / found['bare'][1]:.2f} times)")  # fmt: skip


class _Nothing:
    def write(self, values):
        pass

    def event(self, event):
        pass


if __name__ == "__main__":
    given = [float(each) for each in sys.argv[1:]]
    arms, minutes, first = (*given, *(10.0, 60.0, 0.0)[len(given) :])
    static_loads(int(arms), int(first))
    walls(10)
    spirals(minutes)
    times()
