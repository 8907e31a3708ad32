"""A finger learns to reach: the cross-entropy method on a policy of one layer, in plain NumPy.

    pip install 'contid[learn]'
    python examples/learn_reach.py reach.onnx
    contid run finger --mock --policy reach.onnx --goal x_mm=30,y_mm=85 < /dev/null

Eight generations (2 min of processor time) do not reach yet: 0 of 20 new goals within 2 % of the reach after
3 s. Take more generations and longer episodes.

Options: --robot, --generations, --workers, --seed.
"""

import argparse
import time
from multiprocessing import get_context

import numpy as np

from contid_learn import PolicyAbout, TipEnv, write_policy

POPULATION, BEST, EPISODES = 20, 5, 6
# Of the drawn numbers. A bias is an offset of the tip where the policy comes to rest: a small one.
WEIGHT, BIAS = 5.0, 0.1
ENV = None


def environment(robot):
    global ENV
    if ENV is None:
        ENV = TipEnv(robot, task="reach", episode_s=3.0, randomise={"response_ms": (8.0, 25.0)})
    return ENV


def used(env):
    """The numbers of the observation that the policy looks at: the ways from the tips to their goals."""
    places, at = [], 0
    for view in env.views:
        begin = at + 2 * len(view.columns) + view.dimension
        places += range(begin, begin + view.dimension)
        at += view.width
    return places


def split(numbers, env):
    """Weights and biases of the layer."""
    places = used(env)
    weights = np.zeros((env.action_space.shape[0], env.observation_space.shape[0]))
    numbers = numbers.reshape(len(weights), len(places) + 1)
    weights[:, places] = WEIGHT * numbers[:, :-1]
    return weights, BIAS * numbers[:, -1]


def score(job):
    """Mean return of a policy over the episodes of some seeds, and the share that arrives."""
    robot, numbers, seeds = job
    env = environment(robot)
    weights, bias = split(numbers, env)
    total, arrived = 0.0, 0
    for seed in seeds:
        seen, info = env.reset(seed=int(seed))
        done = False
        while not done:
            seen, reward, failed, over, info = env.step(np.tanh(weights @ seen + bias))
            total += reward
            done = failed or over
        arrived += info["is_success"]
    return total / len(seeds), arrived / len(seeds)


def main():
    options = argparse.ArgumentParser()
    options.add_argument("file", nargs="?", default="reach.onnx")
    options.add_argument("--robot", default="finger")
    options.add_argument("--generations", type=int, default=8)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    rng, begin = np.random.default_rng(given.seed), time.monotonic()
    env = environment(given.robot)
    count = env.action_space.shape[0] * (len(used(env)) + 1)
    mean, spread = np.zeros(count), np.ones(count)
    with get_context("spawn").Pool(given.workers) as pool:
        for generation in range(given.generations):
            seeds = rng.integers(2**31, size=EPISODES)  # the same goals for all of a generation
            drawn = mean + spread * rng.normal(size=(POPULATION, count))
            found = pool.map(score, [(given.robot, numbers, seeds) for numbers in drawn], chunksize=2)
            returns = np.array([each[0] for each in found])
            best = drawn[np.argsort(returns)[-BEST:]]
            mean, spread = best.mean(axis=0), best.std(axis=0) + 0.8**generation / 3.0
            print(f"{generation}: return {returns.mean():.2f}, best {returns.max():.2f}", flush=True)
        tests = [(given.robot, mean, [seed]) for seed in range(10**6, 10**6 + 20)]
        results = pool.map(score, tests)
    weights, bias = split(mean, env)
    write_policy(given.file, PolicyAbout.of(env.views, env.rate_hz, "reach"), [(weights, bias)])
    env.close()
    arrived = np.mean([each[1] for each in results])
    took = time.monotonic() - begin
    print(f"{given.file}: {100 * arrived:.0f} % of 20 new goals reached, after {took:.0f} s")


if __name__ == "__main__":
    main()
