"""Orders to stop amid a live stream keep the jerk of robots whose axes share limits."""

from __future__ import annotations

import numpy as np
import pytest

from contid.control.engine.live.target_follower import TargetFollower
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import hold, stop
from contid.robot_file.base import StopPolicy
from contid.targets import Target
from tests.campaign.live.random_streams import OVER, Stage, rows_of, staged

STREAMS = 6


def greatest_jerk(stage: Stage, number: int, policy: StopPolicy | None) -> tuple[float, RobotState]:
    """Greatest jerk as a share of the limit; amid the stream comes a stop by a policy, or None for a hold."""
    config, state, queue = stage.config, stage.state, rows_of(stage, number)[::-1]
    follower = TargetFollower(config)
    follower.put(Target(tip_m=config.frame.point_in_world(stage.tip_m)), stage.now_s, state)
    stops = int(np.random.default_rng(number).uniform(0.2, 1.0) / config.period_s)
    commands = [state.command] * 3
    for count in range(stops + 2000):
        time_s = count * config.period_s
        now_s = stage.now_s + time_s
        while queue and queue[-1][0] <= time_s:
            tip = config.frame.point_in_world(queue.pop()[1])
            follower.put(Target(tip_m=tip), now_s, state)
        target = follower.target(now_s, state) if count < stops else None
        if count == stops:
            state = hold(config, state, now_s) if policy is None else stop(config, state, policy, now_s)
        state = tick(config, state, now_s, (), target, live=True).state
        commands.append(state.command)
        if count > stops and (state.mode is Mode.OFF or (state.mode is Mode.HOLD and state.motion is None)):
            break
    jerk = np.abs(np.diff(commands, 3, axis=0)) / config.period_s**3 / np.array(config.jerk)
    return float(jerk.max()), state


@pytest.mark.parametrize("policy", [None, StopPolicy.REST], ids=["hold", "rest"])
@pytest.mark.parametrize("name", ["finger", "trirack2"])
def test_a_stop_amid_a_stream_keeps_the_jerk(name: str, policy: StopPolicy | None) -> None:
    stage = staged(name)
    for number in range(9_000_000, 9_000_000 + STREAMS):
        most, state = greatest_jerk(stage, number, policy)
        assert most <= OVER, number
        assert state.mode is (Mode.HOLD if policy is None else Mode.OFF)
        if policy is not None:
            assert state.command == stage.config.rest
