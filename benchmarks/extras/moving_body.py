"""What a look of the simulated bus at a moving body takes: ``python -m benchmarks.extras.moving_body``.

Every 2 ms, random moves at the full rates of the robot file, 10 g on the tip. The motion is the same to the
bit in every run, so the least of several runs at each look is what the look itself takes, and what a run has
above it is of the machine. Times are those of the processor.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np

from contid.control.tick.transmission import axis_map
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.tendon.robot import TendonRobot
from contid.trajectory.approach import Approach
from contid_dynamics.body import STEP_S, MovingBody
from contid_dynamics.schedule import random_actuations

SIM = "    sim: {dynamics: true, payload_g: 10}\n    rates:"
#: Looks at rest behind each move, and moves before they come again.
RESTS = 200
MOVES = 200


def run(name: str, looks: int) -> Array:
    """Processor time of each look [us]."""
    text = load_named(name).text.replace("    rates:", SIM, 1)
    (robot,) = parse_robot_file(text, f"{name}.yaml").driven.values()
    assert isinstance(robot, (Cosserat, TendonRobot))
    straight = isinstance(robot, TendonRobot)
    shafts = [axis_map(robot.axes[axis])[0] for axis in robot.axis_names] if straight else []
    goals = random_actuations(robot, MOVES, seed=3, share=0.6 if straight else 1.0)

    def devices(row: tuple[float, ...]) -> list[float]:
        return [of(value) for of, value in zip(shafts, row, strict=True)] if shafts else list(row)

    body, place, now_s = MovingBody(robot), tuple(goals[0].tolist()), 0.0
    body.follow(devices(place), now_s)
    took: list[int] = []
    while len(took) < looks:
        goal = tuple(goals[math.ceil(len(took) / RESTS) % MOVES].tolist())
        way = Approach(place, [0.0] * len(place), goal, *robot.rate_limits, straight=straight)
        for step in range(1, RESTS + math.ceil(way.duration_s / STEP_S)):
            now_s += STEP_S
            reported = devices(way.at(min(step * STEP_S, way.duration_s))[0])
            begun = time.thread_time_ns()
            body.follow(reported, now_s)
            took.append(time.thread_time_ns() - begun)
        place = goal
    assert not body.lost
    return 1e-3 * np.array(took[:looks])


def main() -> None:
    """Print each robot."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robots", nargs="*", default=["stiffflop2", "tendon3"])
    parser.add_argument("--looks", type=int, default=10_000)
    parser.add_argument("--runs", type=int, default=6)
    asked = parser.parse_args()
    for name in asked.robots:
        runs = np.array([run(name, asked.looks) for _ in range(asked.runs)])
        own = np.percentile(runs, 99, axis=1)
        median, most, last = np.percentile(runs.min(axis=0), [50, 99, 100])
        print(
            f"{name}, {asked.looks} looks: the least of {asked.runs} runs {median:.0f} us, 99 % {most:.0f}, "
            f"greatest {last:.0f}; 99 % of single runs {own.min():.0f} to {own.max():.0f} us",
            flush=True,
        )


if __name__ == "__main__":
    main()
