"""What must hold of the motion in every case: limits, tensions, no jumps, distances between bodies."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from contid.control.engine.tick_layout import ENABLED
from contid.control.tick.config import RobotConfig
from contid.control.tick.supervisor import Mode
from contid.kinematics.tendon.model import TendonModel
from contid.targets import ZERO3
from contid_clearance.file_clearance import clearance_guard
from contid_clearance.guard import Shapes
from contid_drivers.sim.options import SimAxisOptions
from tests.campaign.watch import Seen

#: Rounding of float64 in lengths of metres and pressures of 1e5 Pa, with room for a few operations.
ROUNDING = 1e-9
#: The same of tensions: a tolerance of 1 nm times the stiffness of a tendon.
TENSION_N = 1e-4
#: By which a pair may miss its margin: resolution of the check, and between samples of the bodies [m].
NEARER_M = 1.5e-4

_DRIVEN = (Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING, Mode.FAULT)


def robots_of(seen: Seen) -> Iterator[tuple[int, RobotConfig]]:
    """Place and configuration of every robot."""
    yield from enumerate(seen.case.machine.configs)


def _moving(seen: Seen) -> Iterator[tuple[int, RobotConfig, bool]]:
    """Every robot, judged by its commands; one whose commands are shaped once more, by what goes out."""
    for robot, config in robots_of(seen):
        yield robot, config, False
        if config.shaping is not None:
            yield robot, config, True


def _commands(
    seen: Seen, robot: int, goes_out: bool
) -> Iterator[tuple[int, tuple[float, ...], tuple[float, ...]]]:
    """Place in the records and actuation of every tick that commanded something, and of the tick before."""
    _, config = list(robots_of(seen))[robot]
    last: tuple[float, ...] = ()
    for place, record in enumerate(seen.records):
        axes = record.robots[robot].axes
        device = tuple(axis.device for axis in axes)
        now = tuple(axis.command for axis in axes)
        if not all(map(math.isnan, device)):
            if goes_out:
                now = config.transmission.to_actuation(device)
            yield place, now, last
        last = now


def position(seen: Seen) -> Iterator[str]:
    """Commands are numbers and inside the limits; an arm found outside only moves inwards."""
    for robot, config, goes_out in _moving(seen):
        slack = [ROUNDING * max(abs(a.lower), abs(a.upper)) for a in config.limits]
        for place, command, last in _commands(seen, robot, goes_out):
            device = [axis.device for axis in seen.records[place].robots[robot].axes]
            if not all(map(math.isfinite, (*command, *device))):
                yield f"{config.name}: command {command} at {place}"
                return
            for axis, value, old, room in zip(config.limits, command, last, slack, strict=True):
                if not min(axis.lower, old) - room <= value <= max(axis.upper, old) + room:
                    yield f"{config.name}: {value} outside {axis.lower}..{axis.upper} at {place}"
                    return


def rates(seen: Seen) -> Iterator[str]:
    """Velocity and acceleration between consecutive commands, from standstill at the first."""
    for robot, config, goes_out in _moving(seen):
        before, steps = -2, (0.0,) * len(config.axes)
        for place, command, last in _commands(seen, robot, goes_out):
            if before != place - 1:
                steps = (0.0,) * len(config.axes)
            now = tuple(a - b for a, b in zip(command, last, strict=True))
            for axis, step, old in zip(config.limits, now, steps, strict=True):
                room = ROUNDING * max(abs(axis.lower), abs(axis.upper))
                if abs(step) > axis.step + room:
                    yield f"{config.name}: step {step} beyond {axis.step} at {place}"
                    return
                if abs(step - old) > axis.change + 2.0 * room:
                    yield f"{config.name}: change of step {step - old} beyond {axis.change} at {place}"
                    return
            before, steps = place, now


def taut(seen: Seen) -> Iterator[str]:
    """Tensions of a tendon robot: none under the floor or over the largest, beyond what arming found."""
    for robot, config, goes_out in _moving(seen):
        model = config.model
        if not isinstance(model, TendonModel) or model.statics is None:
            continue
        before, low, high = -2, 0.0, 0.0
        for place, command, _ in _commands(seen, robot, goes_out):
            tensions = model.statics.tensions(np.array(command))
            if before != place - 1:  # armed where it stands: measured tensions are what they are
                low = min(float(np.min(tensions)), model.statics.floor_n)
                high = max(float(np.max(tensions)), model.statics.limit_n)
            if np.min(tensions) < low - TENSION_N or np.max(tensions) > high + TENSION_N:
                yield f"{config.name}: tensions {np.min(tensions):.6g}..{np.max(tensions):.6g} N at {place}"
                return
            before = place


def no_jump(seen: Seen) -> Iterator[str]:
    """The first command after arming is what was measured, to rounding; no command without arming."""
    for robot, config in robots_of(seen):
        armed = False
        for place, (was, now) in enumerate(pairwise(seen.records), 1):
            old, new = was.robots[robot], now.robots[robot]
            began = old.mode == Mode.ARMING and new.mode in _DRIVEN and not armed and new.flags & ENABLED
            # A fault between torque and first command: the devices hold by themselves, nothing is sent.
            if began and not math.isnan(new.axes[0].command):
                armed = True
                measured = tuple(axis.value for axis in old.axes)
                # Noise may measure a pressure at its limit beyond it.
                inside = config.transmission.to_device(_within(config, measured))
                present = config.transmission.to_device(tuple(axis.command for axis in new.axes))
                for a, b, c in zip(present, measured, inside, strict=True):
                    if not min(abs(a - b), abs(a - c)) <= _quantum(seen, config):
                        yield f"{config.name}: begins at {a}, measured {b}, at {place}"
                        return
            commanded = not all(math.isnan(axis.device) for axis in new.axes)
            if commanded and not armed:
                yield f"{config.name}: commanded without arming at {place}"
                return
            if not new.flags & ENABLED:
                armed = False


def _within(config: RobotConfig, measured: tuple[float, ...]) -> tuple[float, ...]:
    """The actuation at measurements, within its limits."""
    present = config.transmission.to_actuation(measured)
    return tuple(
        min(max(value, each.lower), each.upper) for value, each in zip(present, config.limits, strict=True)
    )


def _quantum(seen: Seen, config: RobotConfig) -> float:
    """Resolution of the coarsest simulated device [rad or Pa]."""
    from contid_drivers.sim.devices import character_of

    wiring = [
        bus for bus in seen.case.machine.loaded.buses.values() for axis, _ in bus.axes if axis in config.axes
    ]
    return max(
        character_of(options).quantum
        for bus in wiring
        for axis, options in bus.axes
        if axis in config.axes and isinstance(options, SimAxisOptions)
    )


def apart(seen: Seen) -> Iterator[str]:
    """Bodies never come nearer than the file states; those that are nearer already come no nearer."""
    if seen.case.machine.loaded.file.clearance is None:
        return
    guard = clearance_guard(seen.case.machine.loaded)
    floors = dict.fromkeys(guard.pairs, -math.inf)
    before: dict[str, bool] = {}
    for place, record in enumerate(seen.records):
        at, driven = {}, {}
        for robot, config in robots_of(seen):
            axes = record.robots[robot].axes
            driven[config.name] = not all(math.isnan(axis.device) for axis in axes)
            command = tuple(axis.command for axis in axes)
            values = tuple(axis.value for axis in axes)
            if driven[config.name]:
                at[config.name] = (command, ZERO3)
            elif all(map(math.isfinite, values)):
                at[config.name] = (config.transmission.to_actuation(values), ZERO3)
        shapes = Shapes(guard, at)
        for pair in guard.pairs:
            names = [name for name in pair if name in guard.arms]
            if not all(name in at for name in names):
                continue
            nearest = shapes.nearest(pair, 0.0)
            found = nearest.distance
            # A robot without power may be moved by hand; it is followed only beyond noise.
            if not all(driven[name] and before.get(name, False) for name in names):
                floors[pair] = -math.inf
            if found.upper_m - nearest.least_m < floors[pair] - NEARER_M:
                yield f"{pair[0]} and {pair[1]} {found.upper_m * 1e3:.3f} mm apart at {place}"
                return
            floors[pair] = min(0.0, max(floors[pair], nearest.spare_m))
        before = driven
