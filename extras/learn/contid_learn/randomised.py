"""Draws what is simulated for an episode; what the control loop assumes of the robot stays as it is.

Give intervals that were identified on your robot: then a policy meets it among the robots it learnt on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from contid.errors import ContidError
from contid.hal import load_driver
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import LoadedFile
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid.robot_file.simulated_body import SimulatedTendons
from contid.robot_file.tendon.robot import TendonRobot

#: Keys of simulated axes, of simulated buses, of bodies, and of the errors of pneumatic arms.
OF_AXES: Final = ("response_ms", "noise_deg", "noise_bar", "velocity_deg_s", "slew_bar_s")
OF_BUSES: Final = ("latency_ms",)
OF_BODIES: Final = ("payload_g", "payload_at_s")
OF_ERRORS: Final = ("modulus_percent", "moment_percent", "regulator_bar", "hysteresis_bar")
KEYS: Final = (*OF_AXES, *OF_BUSES, *OF_BODIES, *OF_ERRORS)

#: Interval of each key from which a number is drawn.
Intervals = Mapping[str, tuple[float, float]]


def checked(intervals: Intervals) -> Intervals:
    """Intervals whose keys exist and whose ends are in order.

    Raises:
        ContidError: otherwise.
    """
    for key, ends in intervals.items():
        if key not in KEYS:
            raise ContidError(f"randomise: no key {key!r}; allowed: {', '.join(KEYS)}")
        if len(ends) != 2 or not ends[0] <= ends[1]:
            raise ContidError(f"randomise: {key}: {ends!r} is no interval (low, high)")
    return dict(intervals)


def drawn(intervals: Intervals, rng: np.random.Generator) -> dict[str, float]:
    """A number of every interval, uniformly; the same for every axis of the file."""
    return {key: float(rng.uniform(low, high)) for key, (low, high) in intervals.items()}


def with_bodies(loaded: LoadedFile, moving: bool) -> LoadedFile:
    """Robots that can carry a load get a simulated body; with ``moving`` it has masses and damping.

    Raises:
        ContidError: no robot of the file has one.
    """
    robots = {name: _with_body(robot, moving) for name, robot in loaded.file.robots.items()}
    if all(getattr(robot, "sim", None) is None for robot in robots.values()):
        needs = "model cosserat, or model tendon with dynamics" if not moving else "a key dynamics"
        raise ContidError(f"{loaded.path}: no body to simulate: a robot needs {needs}")
    return replace(loaded, file=loaded.file.model_copy(update={"robots": robots}))


def _with_body(robot: Any, moving: bool) -> Any:
    if isinstance(robot, Cosserat) and (robot.dynamics is not None or not moving):
        body: Any = _changed(robot.sim or SimulatedArm(), {"dynamics": True} if moving else {})
    elif isinstance(robot, TendonRobot) and robot.dynamics is not None:
        body = robot.sim or SimulatedTendons(dynamics=True)
    else:
        return robot
    return robot.model_copy(update={"sim": body})


def varied(loaded: LoadedFile, numbers: Mapping[str, float]) -> LoadedFile:
    """The file with other numbers of its simulated devices and bodies.

    Raises:
        ContidError: a number that they refuse, or none of them has the key.
    """
    used: set[str] = set()

    def mine(keys: Sequence[str], has: Callable[[str], bool] = lambda _: True) -> dict[str, Any]:
        found = {key: numbers[key] for key in keys if key in numbers and has(key)}
        used.update(found)
        return found

    sim = load_driver("sim")
    buses = {}
    for name, bus in loaded.buses.items():
        axes = tuple(
            (axis, _changed(options, mine(OF_AXES, partial(_takes, sim, options))))
            for axis, options in bus.axes
        )
        buses[name] = replace(bus, axes=axes, options=_changed(bus.options, mine(OF_BUSES)))
    robots = {}
    for name, robot in loaded.file.robots.items():
        body: Any = getattr(robot, "sim", None)
        changes = mine(OF_BODIES, partial(hasattr, body))
        if isinstance(robot, Cosserat) and body is not None and (errors := mine(OF_ERRORS)):
            if "modulus_percent" in errors:
                errors["modulus_percent"] = (errors["modulus_percent"],) * len(robot.geometry.sections)
            changes["errors"] = _changed(body.errors, errors)
        robots[name] = robot.model_copy(update={"sim": _changed(body, changes)}) if changes else robot
    if missing := sorted(numbers.keys() - used):
        raise ContidError(f"{loaded.path}: randomise: nothing of this file has {', '.join(missing)}")
    return replace(loaded, buses=buses, file=loaded.file.model_copy(update={"robots": robots}))


def _takes(sim: Any, options: Any, key: str) -> bool:
    """True for a key that the kind of device of an axis has."""
    try:
        sim.axis_options(device=options.device, **{key: 1.0})
    except ValidationError:
        return False
    return True


def _changed(model: Any, changes: Mapping[str, Any]) -> Any:
    """A checked model with other values."""
    if not changes:
        return model
    given = {key: getattr(model, key) for key in model.model_fields_set}
    try:
        return type(model)(**{**given, **changes})
    except ValidationError as error:
        first = error.errors()[0]
        raise ContidError(f"randomise: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
