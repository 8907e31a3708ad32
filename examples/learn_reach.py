"""A robot learns to reach by moving at random: which axes led where becomes a policy of two layers.

    pip install 'contid[learn]'
    python examples/learn_reach.py reach.onnx
    contid run finger --mock --policy reach.onnx --goal x_mm=30,y_mm=85 < /dev/null

Options: --robot, --episodes, --features, --seed.
"""

import argparse
import time

import numpy as np

from contid_learn import PolicyAbout, TipEnv, write_policy

#: Of the differences of axes; with thrice as much the delay of the devices makes a tip circle about its goal.
GAIN = 4.0
#: Axes pass through the first layer as small numbers, where tanh is a straight line.
SMALL = 0.01


def places(env):
    """Where the numbers of the only robot are in an observation: asked axes, tip, way to the goal."""
    (view,) = env.views
    n, d = len(view.columns), view.dimension
    return slice(n, 2 * n), slice(2 * n, 2 * n + d), slice(2 * n + d, 2 * n + 2 * d)


def explored(env, episodes, rng):
    """Axes and tips of episodes that go from one random pose to the next."""
    asked, tip, _ = places(env)
    axes, tips = [], []
    for _ in range(episodes):
        seen, _ = env.reset(seed=int(rng.integers(2**31)))
        over = False
        while not over:
            pose = rng.uniform(-1.0, 1.0, env.action_space.shape)
            for _ in range(20):
                seen, _, failed, late, _ = env.step(np.tanh(GAIN * (pose - seen[asked])))
                axes.append(seen[: asked.start])
                tips.append(seen[tip])
                over = over or failed or late
    return np.array(axes), np.array(tips)


def learnt(env, axes, tips, features, rng):
    """Layers whose action goes to the axes that led to the goal: random features, and ridge regression."""
    asked, tip, way = places(env)
    n, d = axes.shape[1], tips.shape[1]
    centre, spread = tips.mean(axis=0), tips.std(axis=0)
    inner = rng.normal(size=(features, d)) / spread
    offset = rng.uniform(-2.0, 2.0, features) - inner @ centre
    hidden = np.column_stack([np.tanh(tips @ inner.T + offset), np.ones(len(tips))])
    square = hidden.T @ hidden + 1e-6 * len(tips) * np.eye(features + 1)
    outer = np.linalg.solve(square, hidden.T @ axes).T
    first = np.zeros((features + n, env.observation_space.shape[0]))
    first[:features, tip] = first[:features, way] = inner  # the goal is the tip and the way to it
    first[features:, asked] = SMALL * np.eye(n)
    second = GAIN * np.column_stack([outer[:, :-1], -np.eye(n) / SMALL])
    return [(first, np.concatenate([offset, np.zeros(n)])), (second, GAIN * outer[:, -1])]


def main():
    options = argparse.ArgumentParser()
    options.add_argument("file", nargs="?", default="reach.onnx")
    options.add_argument("--robot", default="finger")
    options.add_argument("--episodes", type=int, default=60)
    options.add_argument("--features", type=int, default=150)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    rng, begin = np.random.default_rng(given.seed), time.process_time()
    env = TipEnv(given.robot, task="reach", randomise={"response_ms": (8.0, 25.0)})
    axes, tips = explored(env, given.episodes, rng)
    layers = learnt(env, axes, tips, given.features, rng)
    write_policy(given.file, PolicyAbout.of(env.views, env.rate_hz, "reach"), layers)
    took = time.process_time() - begin
    arrived = []
    for seed in range(10**6, 10**6 + 20):
        seen, info = env.reset(seed=seed)
        over = False
        while not over:
            action = seen
            for weights, bias in layers:
                action = np.tanh(weights @ action + bias)
            seen, _, failed, late, info = env.step(action)
            over = failed or late
        arrived.append(info["is_success"])
    env.close()
    print(f"{given.file}: {sum(arrived)} of 20 new goals reached, after {took:.0f} s of processor time")


if __name__ == "__main__":
    main()
