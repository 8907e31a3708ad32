"""Replacement of invalid values, so that the rest of a robot file can still be checked.

After the findings of a part are collected, its invalid values are dropped or replaced, and the checks that
involve several keys run on the rest. The result never leaves the loader.
"""

from __future__ import annotations

import copy
import json
from typing import Final, TypeVar

from pydantic import BaseModel, ValidationError

from contid.robot_file.positions import Data, step_into

_Model = TypeVar("_Model", bound=BaseModel)
#: A replaced value can cause the next error.
_ROUNDS: Final = 4


def recover(kind: type[_Model], data: Data) -> _Model | None:
    """``data`` as a ``kind`` with every invalid value dropped or replaced; None when that fails."""
    data = copy.deepcopy(data)
    for _ in range(_ROUNDS):
        try:
            return kind.model_validate_json(json.dumps(data), strict=True)
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                _replace(data, detail["loc"], detail["type"], detail.get("ctx", {}))
    return None


def _replace(data: Data, location: tuple[str | int, ...], kind: str, context: dict[str, object]) -> None:
    table, parent = None, data
    for step in location[:-1]:
        # A location also holds the tags of unions; those are no steps.
        below = step_into(parent, step)
        table, parent = (parent, below[0]) if below else (table, parent)
    key = location[-1] if location else None
    if isinstance(table, list) and isinstance(parent, list):
        table[:] = [row for row in table if row is not parent]
    elif isinstance(parent, list) and isinstance(key, int):
        if kind in ("float_type", "finite_number") and len(parent) > 1:
            parent[key] = parent[key - 1] if key else parent[1]
        else:
            parent[key:] = [0.0] if kind in ("missing", "float_type", "finite_number") else []
    elif isinstance(parent, dict) and isinstance(key, str):
        bound = context.get("gt", context.get("ge", context.get("lt", context.get("le"))))
        if kind == "missing" or (kind in ("float_type", "finite_number") and key in parent):
            parent[key] = 1.0
        elif isinstance(bound, (int, float)) and key in parent:
            parent[key] = bound + (1.0 if "gt" in context else -1.0 if "lt" in context else 0.0)
        elif kind == "value_error" and isinstance(parent.get(key), list):
            parent[key] = _increasing(parent[key])
        else:
            parent.pop(key, None)


def _increasing(data: Data) -> Data:
    """The numbers of a list in rising order; other data unchanged."""
    if not isinstance(data, list):
        return data
    numbers: list[float] = sorted(item for item in data if isinstance(item, (int, float)))
    return [*numbers]
