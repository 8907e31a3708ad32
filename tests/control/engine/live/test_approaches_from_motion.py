"""A robot in motion that is to go elsewhere stops first, in APPROACH: it shows no HOLD before it is there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contid.control.engine.events.run import SourceEnded, StopBegan
from contid.control.engine.messages import Begin, EndOfRows, Finish, Goto, Rows
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.transitions import estop, fail, hold, stop
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Target, Vec3
from tests.control.engine.streamed import Followed, Run, middle

#: Robots whose axes share limits.
ROBOTS = ("finger", "trirack", "catheter")
SECONDS = 2.0
#: Of the way to and fro, half of it [m].
SWAY_M = 0.01


class Amid:
    """A robot amid a live stream to and fro, and what it shows and commands afterwards."""

    def __init__(self, name: str) -> None:
        self.run = Run(name)
        self.tip_m = middle(self.run)
        self.run.at_rest_on(self.at(0.0))
        self.axes = list(self.run.follow([(k / 100.0, self.at(k / 100.0)) for k in range(300)], 1.3).axes)
        self.modes: list[Mode] = []
        self.states: list[RobotState] = []
        assert np.abs(np.diff(self.axes[-2:], axis=0)).max() > 0.0

    def at(self, time_s: float) -> Vec3:
        """The tip of the stream at a time."""
        x, y, z = self.tip_m
        sway_m = SWAY_M * (1.0 - math.cos(2.0 * math.pi * time_s / 0.8))
        return (x, y, z + sway_m) if self.run.config.name == "catheter" else (x + sway_m, y, z)

    def target(self, time_s: float) -> Target:
        """The same as a target."""
        axes = self.run.config.model.inverse(
            Target(tip_m=self.at(time_s)), self.run.engine.robots.states[0].command
        )
        tip_m = self.run.config.model.forward(axes.actuation).tip_m
        return Target(tip_m=self.run.config.frame.point_in_world(tip_m))

    def obey(self, *orders: object) -> None:
        """Orders of one tick."""
        for order in orders:
            self.run.engine.obey(order, self.run.process.tick)

    def goes_on(self, seconds: float = SECONDS) -> None:
        """Tick, and keep what is shown and commanded."""
        for _ in range(round(seconds / self.run.config.period_s)):
            self.run.tick()
            state = self.run.engine.robots.states[0]
            self.modes.append(state.mode)
            self.states.append(state)
            if state.mode is not Mode.OFF:
                self.axes.append(np.array(state.command))

    def shown(self) -> list[Mode]:
        """The modes in their order."""
        return [mode for k, mode in enumerate(self.modes) if k == 0 or mode is not self.modes[k - 1]]

    def off_m(self, target: Target) -> float:
        """How far the tip is from a target."""
        config = self.run.config
        tip_m = config.frame.point_in_world(config.model.forward(self.states[-1].command).tip_m)
        assert target.tip_m is not None
        return math.dist(tip_m, target.tip_m)

    def holds_its_limits(self) -> bool:
        followed = Followed(np.array([]), np.array(self.axes), np.array([]), np.array([]))
        return max(self.run.rates(followed)) <= 1.0 + 1e-6


def end_of_a_jog(name: str) -> Amid:
    """The stream ends as that of a jog: its last row is a goto."""
    it = Amid(name)
    it.obey(Begin(), Goto(it.run.config.name, it.target(2.0)))
    return it


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_shows_hold_after_the_last_row_of_a_jog_moves_no_more(name: str) -> None:
    """Who waited for HOLD saw it go on by 3 to 6 mm."""
    it = end_of_a_jog(name)
    it.goes_on()
    assert it.shown() == [Mode.APPROACH, Mode.HOLD]
    assert it.holds_its_limits()
    stood = it.modes.index(Mode.HOLD)
    assert {state.command for state in it.states[stood:]} == {it.states[-1].command}
    assert it.off_m(it.target(2.0)) < 1e-6


@pytest.mark.parametrize("name", ROBOTS)
def test_the_newest_goto_is_approached_however_far_the_robot_has_braked(name: str) -> None:
    for ticks in (1, 3, 8):
        it = end_of_a_jog(name)
        it.goes_on(ticks * it.run.config.period_s)
        newest = it.target(0.2)
        it.obey(Goto(it.run.config.name, newest))
        it.goes_on()
        assert it.shown() == [Mode.APPROACH, Mode.HOLD]
        assert it.holds_its_limits()
        assert it.off_m(newest) < 1e-6


@pytest.mark.parametrize("name", ROBOTS)
def test_after_a_refused_row_the_next_good_one_is_approached_at_once(name: str) -> None:
    it = Amid(name)
    it.obey(Rows({it.run.config.name: None}))
    it.goes_on(2 * it.run.config.period_s)
    it.obey(Rows({it.run.config.name: it.target(2.0)}))
    it.goes_on()
    assert it.shown() == [Mode.HOLD, Mode.APPROACH, Mode.RUN]
    assert it.modes.count(Mode.HOLD) == 2
    assert it.holds_its_limits()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_stream_ends_when_its_last_row_is_reached_though_the_robot_brakes_first(name: str) -> None:
    it = Amid(name)
    it.obey(Rows({it.run.config.name: None}))
    it.goes_on(it.run.config.period_s)
    last = it.target(2.0)
    it.obey(Rows({it.run.config.name: last}), EndOfRows())
    while not any(isinstance(event, SourceEnded) for event in it.run.events):
        it.goes_on(it.run.config.period_s)
        assert len(it.modes) < 2000
    assert it.off_m(last) < 1e-5


@pytest.mark.parametrize("name", ROBOTS)
def test_a_jog_that_ended_starts_nothing_while_the_robot_brakes(name: str) -> None:
    """A row was refused and the next one is approached when the stream ends without a last row."""
    it = Amid(name)
    it.obey(Rows({it.run.config.name: None}))
    it.goes_on(it.run.config.period_s)
    it.obey(Rows({it.run.config.name: it.target(2.0)}))
    it.goes_on(2 * it.run.config.period_s)
    assert it.shown()[-1] is Mode.APPROACH
    it.obey(Begin())
    it.goes_on()
    assert it.shown()[-1] is Mode.HOLD
    assert Mode.RUN not in it.modes
    assert it.holds_its_limits()


def to_the_end(config: RobotConfig, state: RobotState, now_s: float) -> tuple[list[Actuation], RobotState]:
    """The commands of the ticks from a time on, without a target, and the last state."""
    commands = []
    for count in range(round(0.5 / config.period_s)):
        state = tick(config, state, now_s + count * config.period_s, (), None).state
        commands.append(state.command)
    return commands, state


@pytest.mark.parametrize("name", ROBOTS)
def test_a_stop_in_any_tick_of_the_brake_ends_it_and_no_approach_follows(name: str) -> None:
    it = end_of_a_jog(name)
    config, first_s = it.run.config, it.run.process.tick * it.run.config.period_s
    it.goes_on()
    second_s = first_s + config.period_s
    stopped, _ = to_the_end(config, hold(config, it.states[0], second_s), second_s)
    brakes = stopped.index(stopped[-1])  # its ticks after the first
    assert brakes > 5
    for count in range(1, brakes):
        braking, now_s = it.states[count - 1], first_s + count * config.period_s
        assert braking.mode is Mode.APPROACH
        rest_of_it = stopped[count - 1 :]
        for order, ends in (
            (hold(config, braking, now_s), Mode.HOLD),
            (stop(config, braking, StopPolicy.HOLD, now_s), Mode.OFF),
            (fail(config, braking, Fault.CONTACT, "a contact", now_s), Mode.FAULT),
        ):
            assert order.mode is not Mode.APPROACH
            commands, after = to_the_end(config, order, now_s)
            assert after.mode is ends
            assert after.goto is None
            as_ended = np.array(rest_of_it + [stopped[-1]] * len(commands))[: len(commands)]
            assert np.abs(np.array(commands) - as_ended).max() < 1e-12
        off = estop(config, braking, now_s)
        assert off.mode is Mode.OFF
        assert not off.enabled
        assert off.motion is None
        assert to_the_end(config, off, now_s)[1] == off


@pytest.mark.parametrize("name", ROBOTS)
def test_the_end_of_a_run_states_the_whole_time_of_its_way_to_rest(name: str) -> None:
    """The daemon relaxes robots that are not at rest 0.8 s after it."""
    it = Amid(name)
    it.obey(Finish(StopPolicy.REST))
    it.goes_on(8.0)
    (stated,) = [event.seconds for event in it.run.events if isinstance(event, StopBegan)]
    assert it.shown() == [Mode.STOPPING, Mode.OFF]
    assert stated == pytest.approx(it.modes.index(Mode.OFF) * it.run.config.period_s, abs=0.03)
    assert it.holds_its_limits()
