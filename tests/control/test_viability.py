"""How far an axis goes on that stops: the estimates of the tick beside ways that ruckig computes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import ruckig

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.kinematics.array import Array
from contid.robot_file.load import load_named
from contid.trajectory.pursuit import MovingAxes


def config_of(robot: str) -> RobotConfig:
    loaded = load_named(robot)
    return next(iter(build_robot_configs(loaded, loaded.file.rate_hz)))


def stop_length(velocity: float, acceleration: float, greatest: float, jerk: float) -> float:
    """The way of the shortest stop of one axis, by ruckig."""
    given = ruckig.InputParameter(1)
    given.control_interface = ruckig.ControlInterface.Velocity
    given.current_position, given.current_velocity, given.current_acceleration = (
        [0.0],
        [velocity],
        [acceleration],
    )
    given.target_velocity, given.target_acceleration = [0.0], [0.0]
    given.max_acceleration, given.max_jerk = [greatest], [jerk]
    way = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(given, way) in (ruckig.Result.Working, ruckig.Result.Finished)
    return max(float(way.at_time(share * way.duration)[0][0]) for share in np.linspace(0.0, 1.0, 201))


def test_an_axis_goes_on_where_its_stop_ends_inside_and_only_there() -> None:
    config, draw = config_of("finger"), np.random.default_rng(3)
    h, limits = config.period_s, config.limits[0]
    top, greatest, jerk = config.velocity[0], config.acceleration[0], config.jerk[0]
    for _ in range(300):
        velocity, acceleration = draw.uniform(0.0, top), draw.uniform(-greatest, greatest)
        way = stop_length(velocity, acceleration, greatest, jerk)
        least, most = limits.upper - way - 1e-6, limits.upper - way + 1e-6
        fast = velocity + 0.5 * acceleration * abs(acceleration) / jerk > top
        turns_back = acceleration < 0.0 and acceleration**2 > 2.0 * velocity * jerk  # judged with a margin
        assert turns_back or config.guard.viable(0, least, velocity * h, acceleration * h * h) is not fast
        assert not config.guard.viable(0, most, velocity * h, acceleration * h * h)


def test_a_deceleration_above_its_greatest_by_rounding_does_not_shorten_the_stop() -> None:
    """Of an axis that is fast for its acceleration: 0.9 m/s, 1 m/s^2 and 20 m/s^3."""
    given = config_of("finger")
    h, greatest, jerk = given.period_s, 1.0, 20.0
    limits, axes = AxisLimits(0.0, 1.0, 1.0 * h, greatest * h * h), len(given.limits)
    config = replace(
        given,
        limits=(limits,) * axes,
        velocity=(1.0,) * axes,
        acceleration=(greatest,) * axes,
        jerk=(jerk,) * axes,
    )
    at = 1.0 - 0.9 * stop_length(0.9, -greatest, greatest, jerk)
    for share in (1.0, 1.0 + 1e-12, 1.0 + 1e-6):
        assert not config.guard.viable(0, at, 0.9 * h, -greatest * share * h * h)
    before = replace(config, motion_rules=2)  # recordings by these rules replay by them
    assert before.guard.viable(0, at, 0.9 * h, -greatest * (1.0 + 1e-6) * h * h)


def test_axes_that_are_slow_and_accelerate_stop_inside_the_limit_they_share() -> None:
    """A stop that exceeds the shared limit is never taken for one that keeps it."""
    config, draw = config_of("finger"), np.random.default_rng(4)
    greatest, jerk = np.array(config.acceleration), np.array(config.jerk)
    count = len(greatest)
    exceeded = 0
    lower, upper = (np.array([getattr(each, end) for each in config.limits]) for end in ("lower", "upper"))
    for _ in range(400):
        position = draw.uniform(lower, upper)
        velocity = draw.uniform(-0.1, 0.1, count) * config.velocity
        acceleration = draw.uniform(-1.0, 1.0, count) * greatest
        state = MovingAxes(*(tuple(each.tolist()) for each in (position, velocity, acceleration)))
        last = tuple(position.tolist())
        if config.guard.excess(last) > 0.0 or not config.guard.stops_inside(state, last):
            continue
        given = ruckig.InputParameter(count)
        given.control_interface = ruckig.ControlInterface.Velocity
        given.current_position, given.current_velocity = position.tolist(), velocity.tolist()
        given.current_acceleration = acceleration.tolist()
        given.target_velocity = given.target_acceleration = [0.0] * count
        given.max_acceleration, given.max_jerk = greatest.tolist(), jerk.tolist()
        way = ruckig.Trajectory(count)
        ruckig.Ruckig(count).calculate(given, way)
        most = max(
            config.guard.excess(tuple(way.at_time(share * way.duration)[0]))
            for share in np.linspace(0, 1, 65)
        )
        exceeded += most > 1e-5
    assert exceeded == 0


class Watched:
    """A shared limit that every state keeps; it notes the states."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, ...]] = []

    def excess(self, axes: tuple[float, ...]) -> tuple[float]:
        self.asked.append(axes)
        return (-1e-9,)

    def gradient(self, axes: tuple[float, ...], number: int) -> tuple[float, ...]:
        return (0.0,) * len(axes)


def ways_of_stop(
    velocity: Array, acceleration: Array, greatest: Array, jerk: Array, period_s: float
) -> Array:
    """Ways in the ticks of the stop of axes that end it together, by ruckig, shape ``(ticks, axes)``."""
    count = len(velocity)
    asked = ruckig.InputParameter(count)
    asked.control_interface = ruckig.ControlInterface.Velocity
    asked.current_position, asked.current_velocity = [0.0] * count, velocity.tolist()
    asked.current_acceleration = acceleration.tolist()
    asked.target_velocity = asked.target_acceleration = [0.0] * count
    asked.max_acceleration, asked.max_jerk = greatest.tolist(), (jerk * (1.0 - 1e-6)).tolist()
    way = ruckig.Trajectory(count)
    ruckig.Ruckig(count).calculate(asked, way)
    ticks = math.ceil(way.duration / period_s - 1e-6)
    return np.array([way.at_time(min((k + 1) * period_s, way.duration))[0] for k in range(ticks)])


def test_states_of_a_stop_are_those_of_ruckig() -> None:
    """Of three axes that end it together, some of which could sooner; or on a line, by shares of one."""
    given, draw = config_of("trirack"), np.random.default_rng(5)
    top, greatest, jerk = (np.array(each) for each in (given.velocity, given.acceleration, given.jerk))
    position = tuple(0.5 * (each.lower + each.upper) for each in given.limits)
    wide = tuple(AxisLimits(-1e3, 1e3, each.step, each.change) for each in given.limits)
    for number in range(300):
        velocity = draw.uniform(-1.0, 1.0, 3) * top * draw.choice([0.1, 1.0])
        acceleration = draw.uniform(-1.0, 1.0, 3) * greatest * draw.choice([0.0, 0.1, 1.0])
        if number % 5 == 0:
            acceleration = velocity * draw.uniform(-5.0, 5.0)
        if number % 5 == 0 or not acceleration.any():
            shares = velocity / velocity[0]
            most, jolt = ((each / np.abs(shares)).min(keepdims=True) for each in (greatest, jerk))
            ways = ways_of_stop(velocity[:1], acceleration[:1], most, jolt, given.period_s) * shares
        else:
            ways = ways_of_stop(velocity, acceleration, greatest, jerk, given.period_s)
        state = MovingAxes(position, tuple(velocity.tolist()), tuple(acceleration.tolist()))
        watched = Watched()
        assert replace(given, shared=watched, limits=wide).guard.stops_inside(state, position)
        states = np.array(watched.asked[-len(ways) :]) - position
        assert np.abs(states - ways).max() < 1e-9, (number, velocity, acceleration)
