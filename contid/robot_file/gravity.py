"""Which way the weight of a robot acts: one ``down`` of the world, carried through ``base``.

Earlier revisions of robot files had ``gravity``, a direction in the base frame, with another default for each
model. Files with it are refused with the line to write; recordings with it are read as they were meant.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from pydantic import ValidationError

from contid.errors import Located
from contid.robot_file.base import BasePose
from contid.robot_file.positions import Document, KeyPath
from contid.robot_file.robot import RobotDescription
from contid.targets import Vec3

#: Where each model had ``gravity``, and its default in the base frame.
_OLD: Final[Mapping[str, tuple[str, Vec3]]] = {
    "cosserat": ("geometry", (0.0, 0.0, 1.0)),
    "tendon": ("rod", (0.0, 0.0, -1.0)),
}
#: Unit vectors that differ by less are the same direction.
_SAME: Final = 1e-6


def remedy_for_gravity(raw: Any, key: KeyPath) -> str | None:
    """What to write in place of the key ``gravity`` of a robot; None for any other key.

    Args:
        raw: the robot as it is written.
        key: path of the key in it.
    """
    if not isinstance(raw, dict) or key != (_old_part(raw), "gravity"):
        return None
    down = _in_world(raw, raw[key[0]]["gravity"])
    replaced = "key 'gravity', in the base frame, was replaced by 'down' of the robot, in the world"
    if down is None:
        return f"{replaced}; write down: [x, y, z] beside model; left out, it is [0, 0, -1]"
    if math.dist(down, _down(raw)) < _SAME:
        return f"{replaced}; remove this line: down is {_list(down)} already"
    keep = f"to keep the direction write down: {_list(down)} beside model"
    return f"{replaced}; {keep}, or turn base as the robot is mounted"


def check_down(document: Document, at: KeyPath, robot: RobotDescription) -> Iterator[Located]:
    """A finding where a file without ``down`` may be one that was written for the default of before."""
    part, before = _OLD.get(robot.model, ("", robot.down_in_base))
    now = robot.down_in_base
    if not robot.depends_on_down or "down" in robot.model_fields_set or math.dist(before, now) < _SAME:
        return
    if document.get((*at, part, "gravity")) is not None:
        return  # refused already, with its remedy
    then = _in_world({"base": robot.base.model_dump()}, before)
    assert then is not None
    yield document.at_key(
        (*at, "model"),
        f"down is left out: gravity then acts along {_list(now)} of the base, in earlier revisions along "
        f"{_list(before)}; state it beside model: down: {_list(robot.down_unit)}, or as before {_list(then)}",
    )


def check_one_world(document: Document, robots: Mapping[str, RobotDescription | None]) -> Iterator[Located]:
    """Findings where two robots of a file have another ``down``, or a rope one that is not -z."""
    known = {name: robot for name, robot in robots.items() if robot is not None}
    first = next(((name, robot) for name, robot in known.items() if not robot.passive), None)
    rope = any(robot.passive for robot in known.values())
    if first is None:
        return
    for name, robot in known.items():
        at = ("robots", name, "down")
        if robot.passive:
            continue
        if math.dist(robot.down_unit, first[1].down_unit) > _SAME:
            message = f"down: {_list(robot.down_unit)}, but {first[0]!r} has {_list(first[1].down_unit)}"
            yield document.at_key(at, f"{message}; robots of a file are in one world")
        elif rope and math.dist(robot.down_unit, (0.0, 0.0, -1.0)) > _SAME:
            yield document.at_key(at, "down: a rope hangs along [0, 0, -1] of the world; turn base instead")


def weight_line(robot: RobotDescription) -> str:
    """Which way the weight acts, for ``contid check``; empty for models that have none."""
    if robot.model not in _OLD:
        return ""
    x, y, z = robot.down_in_base
    where = f"along {_list(robot.down_unit)} of the world, {_list((x, y, z))} of the base"
    if not robot.has_weight:
        return f"down is {where}; the model of this robot has no weight of its own"
    angle_deg = math.degrees(math.atan2(math.hypot(x, y), z))
    how = "stands" if angle_deg > 179.0 else "hangs" if angle_deg < 1.0 else "is mounted aslant"
    return f"the weight acts {where}: straight, the robot {how}"


def with_down(raw: Any) -> Any:
    """A robot of a recording with ``down`` in place of ``gravity`` or of its default of then."""
    if not isinstance(raw, dict) or (part := _old_part(raw)) is None:
        return raw
    written = "gravity" in raw[part]
    if not written and (raw["model"] != "cosserat" or "down" in raw):
        return raw
    down = _in_world(raw, raw[part].get("gravity", _OLD[raw["model"]][1]))
    kept = {key: value for key, value in raw[part].items() if key != "gravity"}
    return raw if down is None else {**raw, part: kept, "down": list(down)}


def _old_part(raw: Mapping[str, Any]) -> str | None:
    """The key of a robot that held ``gravity``, where the robot has it."""
    model = raw.get("model")
    part = _OLD[model][0] if isinstance(model, str) and model in _OLD else None
    return part if part is not None and isinstance(raw.get(part), dict) else None


def _in_world(raw: Mapping[str, Any], in_base: Any) -> Vec3 | None:
    """A direction of the base frame as a unit vector of the world; None where either is not valid."""
    try:
        base = BasePose.model_validate(raw.get("base", {}))
        x, y, z = (float(each) for each in in_base)
        length = math.hypot(x, y, z)
        r = base.rotation
        return (
            _tidy((r[0] * x + r[1] * y + r[2] * z) / length),
            _tidy((r[3] * x + r[4] * y + r[5] * z) / length),
            _tidy((r[6] * x + r[7] * y + r[8] * z) / length),
        )
    except (ValidationError, TypeError, ValueError, ZeroDivisionError):
        return None


def _down(raw: Mapping[str, Any]) -> Vec3:
    """``down`` as it is written, or its default."""
    try:
        x, y, z = (float(each) for each in raw.get("down", (0.0, 0.0, -1.0)))
        length = math.hypot(x, y, z)
        return x / length, y / length, z / length
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0, 0.0, -1.0


def _tidy(value: float) -> float:
    """The value with at most twelve digits after the point, and no negative zero."""
    return round(value, 12) + 0.0


def _list(vector: Vec3) -> str:
    return f"[{', '.join(f'{round(value, 6) + 0.0:g}' for value in vector)}]"
