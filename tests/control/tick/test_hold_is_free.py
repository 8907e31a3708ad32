"""A robot that stands in HOLD is not computed, and its ticks are those of one that is."""

from __future__ import annotations

import pytest

from contid.control.engine.messages import Goto, Hold
from contid.control.tick import robot_tick
from contid.control.tick.config import RobotConfig
from contid.control.tick.robot_tick import TickResult
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.targets import Target
from tests.control.engine.streamed import Run
from tests.golden.make import names
from tests.support.robot_configs import one_of_each_family


@pytest.mark.parametrize("name", one_of_each_family(names()))
def test_a_tick_that_is_left_out_would_change_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run(name)
    stands, left_out = robot_tick._stands, []

    def compared(config: RobotConfig, state: RobotState) -> bool:
        if found := stands(config, state):
            left_out.append(config.name)
            at_rest = TickResult(state, config.transmission.to_device(state.command))
            assert robot_tick._move(config, state, 1e3) == at_rest
        return found

    monkeypatch.setattr(robot_tick, "_stands", compared)
    rest = Target(actuation=run.config.rest[: len(run.config.axes) - run.config.extra_axes])
    for order in (Hold(), Goto(run.config.name, rest), Hold()):
        run.engine.obey(order, run.process.tick)
        for _ in range(30):
            run.tick()
    for _ in range(round(2.0 / run.config.period_s)):
        run.tick()
    assert run.mode is Mode.HOLD
    assert len(left_out) > 100


def test_it_is_computed_as_soon_as_it_has_to_move(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Run("finger")
    for _ in range(5):
        run.tick()
    moves: list[Mode] = []
    move = robot_tick._move

    def moved(config: RobotConfig, state: RobotState, now_s: float) -> TickResult:
        moves.append(state.mode)
        return move(config, state, now_s)

    monkeypatch.setattr(robot_tick, "_move", moved)
    for _ in range(10):
        run.tick()
    assert not moves
    config = run.config
    goal = tuple(a + 0.1 * (b.upper - a) for a, b in zip(config.rest, config.limits, strict=True))
    run.engine.obey(Goto(config.name, Target(actuation=goal)), run.process.tick)
    run.tick()
    assert moves
