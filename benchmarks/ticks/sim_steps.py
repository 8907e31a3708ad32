"""Steps of `contid.Sim` per processor second: of each of 240 steps the shortest of several runs.

``python -m benchmarks.ticks.sim_steps [ROBOT ...] [--runs 12] [--every 1] [--profile]``. A path over a fifth
of the ranges, a row of actuations in every step, or in one of ``--every``. ``--profile``: the functions that
take most instead.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time

import numpy as np

from contid import Robot, Sim

STEPS = 240
Row = dict[str, list[float]]


def rows_of(sim: Sim, name: str) -> list[Row]:
    """From the rest pose towards the farther ends of the ranges and back, in the units of robot files."""
    rows: list[Row] = []
    limits = {each: Robot(name)[each].limits for each in sim.names}
    for k in range(STEPS):
        share = 0.1 * (1.0 - np.cos(2.0 * np.pi * k / STEPS))
        rows.append(
            {
                each: (
                    of.rest
                    + share * (np.where(of.max - of.rest > of.rest - of.min, of.max, of.min) - of.rest)
                ).tolist()
                for each, of in limits.items()
            }
        )
    return rows


def shortest_us(sim: Sim, rows: list[Row], runs: int, every: int) -> float:
    """Mean over the steps of the shortest time of each [us]."""
    shortest_ns = [2**62] * STEPS
    for _ in range(runs):
        sim.reset()
        for k, row in enumerate(rows):
            begun_ns = time.thread_time_ns()
            sim.step(row if k % every == 0 else None)
            shortest_ns[k] = min(shortest_ns[k], time.thread_time_ns() - begun_ns)
    return sum(shortest_ns) / STEPS / 1e3


def profile(sim: Sim, rows: list[Row], runs: int) -> None:
    """Print what takes most, and the number of calls of a step."""
    profiler = cProfile.Profile()
    for _ in range(runs):
        sim.reset()
        profiler.enable()
        for row in rows:
            sim.step(row)
        profiler.disable()
    found = pstats.Stats(profiler)
    found.sort_stats("tottime").print_stats(30)
    print(f"{getattr(found, 'total_calls') / runs / STEPS:.0f} calls a step")  # noqa: B009 - not in its stubs


def main() -> None:
    """Print a line for each robot."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robots", nargs="*", default=["finger", "hand", "stiffflop2", "trirack2", "tendon3"])
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--profile", action="store_true")
    asked = parser.parse_args()
    for name in asked.robots:
        with Sim(name) as sim:
            rows = rows_of(sim, name)
            if asked.profile:
                profile(sim, rows, asked.runs)
                continue
            us = shortest_us(sim, rows, asked.runs, asked.every)
            print(f"{name}: {us:.0f} us a step, {1e6 / us:.0f} steps/s", flush=True)


if __name__ == "__main__":
    main()
