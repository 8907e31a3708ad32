"""Keys of robot files that have another name today: refused in files, accepted in recordings."""

from __future__ import annotations

from typing import Any, Final

#: Old key of an axis -> today's.
RENAMED_KEYS: Final = {"dead_man": "on_watchdog", "safe_state": "on_watchdog"}


def with_renamed_keys(data: Any) -> Any:
    """The data of a robot file with today's keys, also where ``placeholder`` lists them."""
    robots = data.get("robots") if isinstance(data, dict) else None
    if not isinstance(robots, dict):
        return data
    return {**data, "robots": {name: _robot(robot) for name, robot in robots.items()}}


def _robot(robot: Any) -> Any:
    if not isinstance(robot, dict):
        return robot
    renamed = dict(robot)
    if isinstance(axes := robot.get("axes"), dict):
        renamed["axes"] = {name: _axis(axis) for name, axis in axes.items()}
    if isinstance(listed := robot.get("placeholder"), list):
        renamed["placeholder"] = [_dotted(key) if isinstance(key, str) else key for key in listed]
    return renamed


def _axis(axis: Any) -> Any:
    return {RENAMED_KEYS.get(k, k): v for k, v in axis.items()} if isinstance(axis, dict) else axis


def _dotted(key: str) -> str:
    parent, dot, last = key.rpartition(".")
    return f"{parent}{dot}{RENAMED_KEYS.get(last, last)}" if parent.startswith("axes.") else key
