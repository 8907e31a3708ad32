"""How far an axis goes on that stops: the estimates of the tick beside ways that ruckig computes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import ruckig

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.limits import AxisLimits
from contid.control.tick.viability import excess, stops_inside, viable
from contid.robot_file.load import load_named
from contid.trajectory.planned_motion import MovingAxes


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
        assert turns_back or viable(config, 0, least, velocity * h, acceleration * h * h) is not fast
        assert not viable(config, 0, most, velocity * h, acceleration * h * h)


def test_a_deceleration_above_its_greatest_by_rounding_does_not_shorten_the_stop() -> None:
    """Of an axis that is fast for its acceleration: 0.9 m/s, 1 m/s^2 and 20 m/s^3."""
    given = config_of("finger")
    h, greatest, jerk = given.period_s, 1.0, 20.0
    limits = AxisLimits(0.0, 1.0, 1.0 * h, greatest * h * h)
    config = replace(given, limits=(limits,), velocity=(1.0,), acceleration=(greatest,), jerk=(jerk,))
    at = 1.0 - 0.9 * stop_length(0.9, -greatest, greatest, jerk)
    for share in (1.0, 1.0 + 1e-12, 1.0 + 1e-6):
        assert not viable(config, 0, at, 0.9 * h, -greatest * share * h * h)
    before = replace(config, motion_rules=2)  # recordings by these rules replay by them
    assert viable(before, 0, at, 0.9 * h, -greatest * (1.0 + 1e-6) * h * h)


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
        if excess(config, last) > 0.0 or not stops_inside(config, state, last):
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
            excess(config, tuple(way.at_time(share * way.duration)[0])) for share in np.linspace(0, 1, 65)
        )
        exceeded += most > 1e-5
    assert exceeded == 0
