"""Steps per processor second of gymnasium environments: one, and lanes of one vector environment.

``python -m benchmarks.extras.gym_lanes [ROBOT] [--lanes 16] [--steps 2000]``. Actions at random within their
space; a step is one action of the policy's rate, which is several ticks of the robot, and a step of each
lane counts. Ticks stand beside it.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np

import contid_learn.envs  # noqa: F401 - registers the environments


def measure(robot: str, lanes: int, steps: int) -> None:
    """Print the rate of lanes; with one of them that of a single environment in its vector."""
    envs = gymnasium.make_vec(f"contid/{robot}-v0", num_envs=lanes, vectorization_mode="sync")
    rng = np.random.default_rng(1)
    envs.reset(seed=1)
    shape = envs.action_space.shape
    actions = rng.uniform(-1.0, 1.0, (64, *(shape or ()))).astype(np.float32)
    begun_s = time.process_time()
    for step in range(max(steps // lanes, 10)):
        envs.step(actions[step % 64])
    took_s = time.process_time() - begun_s
    count = max(steps // lanes, 10) * lanes
    alone = getattr(envs, "envs")[0].unwrapped  # noqa: B009 - of the synchronous kind
    print(f"{robot}, {lanes} lanes: {count / took_s:.0f} steps/s, {alone.ticks * count / took_s:.0f} ticks/s "
          f"({took_s:.1f} processor-s for {count} steps)", flush=True)  # fmt: skip
    envs.close()


def main() -> None:
    """Print one lane and several."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robot", nargs="?", default="finger")
    parser.add_argument("--lanes", type=int, default=16)
    parser.add_argument("--steps", type=int, default=2000)
    asked = parser.parse_args()
    for lanes in dict.fromkeys((1, asked.lanes)):
        measure(asked.robot, lanes, asked.steps)


if __name__ == "__main__":
    main()
