"""Environments against gymnasium's own checker, and their episodes against `Sim` stepped by hand."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import contid_learn.envs
from contid import Sim
from contid.errors import ContidError
from contid.robot_file.load import load_named, with_mock
from contid_learn import TipEnv
from contid_learn.randomised import varied, with_bodies
from contid_learn.tasks import Task


def episode(env: TipEnv, seed: int, steps: int) -> tuple[Any, list[Any]]:
    first, _ = env.reset(seed=seed)
    rng = np.random.default_rng(seed)
    shape = env.action_space.shape
    return first, [env.step(rng.uniform(-1, 1, shape).astype(np.float32)) for _ in range(steps)]


@pytest.mark.parametrize("name", ["finger", "stiffflop2"])
def test_gymnasium_finds_no_fault_and_has_no_warning(name: str) -> None:
    env = gymnasium.make(f"contid/{name}-v0", episode_s=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


def test_every_shipped_robot_has_an_environment() -> None:
    ids = contid_learn.envs.environment_ids()
    assert {"contid/finger-v0", "contid/hand-v0", "contid/tendon3-v0"} <= ids.keys()
    assert not any("emulated" in each for each in ids)
    assert ids.keys() <= gymnasium.registry.keys()


def test_an_episode_is_the_bits_of_a_simulation_stepped_by_hand() -> None:
    env = TipEnv("finger")
    env.reset(seed=4)
    noise = np.random.default_rng(0)
    with Sim("finger") as sim:
        # gymnasium's generator of a seed gives the noise of the devices first.
        generator, _ = gymnasium.utils.seeding.np_random(4)
        state = sim.reset(int(generator.integers(2**31)))
        low, high = np.zeros(2), np.full(2, 100.0)
        asked = np.clip(state["finger"].measured, low, high)
        for _ in range(30):
            action = noise.uniform(-1.5, 1.5, 2).astype(np.float32)
            env.step(action)
            # 60 mm/s at 20 actions per second, ten ticks each
            asked = np.clip(asked + 3.0 * np.clip(action.astype(float), -1, 1), low, high)
            sim.step({"left_mm": asked[0], "right_mm": asked[1]}, ticks=10)
            assert np.array_equal(sim._values, env.sim._values, equal_nan=True)
    env.close()


def test_lanes_are_the_bits_of_single_environments() -> None:
    lanes = gymnasium.make_vec("contid/finger-v0", num_envs=3, vectorization_mode="sync")
    singles = [TipEnv("finger") for _ in range(3)]
    seen, _ = lanes.reset(seed=10)
    alone = np.stack([env.reset(seed=10 + k)[0] for k, env in enumerate(singles)])
    assert np.array_equal(seen, alone)
    rng = np.random.default_rng(1)
    for _ in range(5):
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        seen, rewards, *_ = lanes.step(actions)
        steps = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        assert np.array_equal(seen, np.stack([each[0] for each in steps]))
        assert rewards.tolist() == [each[1] for each in steps]
    lanes.close()
    for env in singles:
        env.close()


def test_a_seed_repeats_an_episode_and_the_next_one_differs() -> None:
    env = TipEnv("finger", task="follow", randomise={"response_ms": (5.0, 40.0), "latency_ms": (0.0, 2.0)})
    first, steps = episode(env, 3, 8)
    again, same = episode(env, 3, 8)
    assert np.array_equal(first, again)
    for one, other in zip(steps, same, strict=True):
        assert np.array_equal(one[0], other[0])
        assert one[1] == other[1]
    assert not np.array_equal(env.reset()[0], first)
    env.close()


def test_the_goal_of_a_path_moves_as_its_velocity_states() -> None:
    env = TipEnv("finger", task="follow")
    env.reset(seed=1)
    (path,) = env._paths.values()
    for time_s in (0.3, 0.9, 1.7):
        change = (path.at(time_s + 1e-4).tip - path.at(time_s - 1e-4).tip) / 2e-4
        assert np.allclose(change, path.at(time_s).velocity, rtol=0.02, atol=0.05)
    assert np.allclose(path.at(2 * path.leg_s).tip, path.at(0.0).tip)
    env.close()


def test_a_load_moves_the_tip_that_a_policy_sees() -> None:
    heavy = {"payload_g": (5.0, 5.0), "payload_at_s": (0.6, 0.6)}
    tips = []
    for randomise in (heavy, {**heavy, "payload_g": (0.0, 0.0)}):
        env = TipEnv("stiffflop2", task="hold", randomise=randomise)
        env.reset(seed=2)
        bend = np.array([1, 0, 0, 1, 0, 0], np.float32)  # a load on a straight arm pulls along it
        tips.append([env.step(bend if step < 7 else 0 * bend)[0][12:15] for step in range(24)])
        env.close()
    apart = np.linalg.norm(np.array(tips[0]) - np.array(tips[1]), axis=1)
    assert apart[:8].max() < 1e-2
    assert apart[-1] > 3e-2


def test_what_is_drawn_changes_the_devices_and_not_the_belief() -> None:
    loaded = with_mock(load_named("stiffflop2"))
    other = varied(with_bodies(loaded, True), {"modulus_percent": 7.0, "response_ms": 44.0})
    (robot,), (before,) = other.driven.values(), loaded.driven.values()
    assert robot.sim.errors.modulus_percent == (7.0, 7.0)  # type: ignore[attr-defined]
    assert robot.sim.dynamics  # type: ignore[attr-defined]
    assert robot.geometry == before.geometry  # type: ignore[attr-defined]
    axes: list[Any] = [options for bus in other.buses.values() for _, options in bus.axes]
    assert {options.response_ms for options in axes} == {44.0}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"task": "juggle"}, "task 'juggle': allowed: reach, follow, hold"),
        ({"rate_hz": 0.0}, "rate_hz=0: allowed: above 0, up to that of the tick, 200"),
        ({"task": "hold"}, "no body to simulate"),
        ({"moving": True}, "no body to simulate"),
        ({"randomise": {"respons_ms": (1, 2)}}, "no key 'respons_ms'; allowed: response_ms"),
        ({"randomise": {"response_ms": (2, 1)}}, "no interval"),
        ({"randomise": {"slew_bar_s": (1, 2)}}, "nothing of this file has slew_bar_s"),
        ({"randomise": {"response_ms": (-1, 2)}}, "response_ms: Input should be greater than or equal to 0"),
    ],
)
def test_mistakes_are_located(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ContidError, match=message.replace("(", r"\(")):
        TipEnv("finger", **options)
    assert [*Task]
