"""Names that a robot file gives to axes: of extra axes and of the drives of tendons."""

from __future__ import annotations

import re
from typing import Final

#: A column is the name with its unit; a dot would be a group of columns.
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_COORDINATES: Final = ("x", "y", "z")
#: With their unit, or as they are, these are keys of other values of a robot in its recording.
_RECORDED: Final = (
    "tip", "mid", "residual", "tip_error", "measured_tip_m", "measured_direction", "measured_age_s",
    "estimated_load_n", "estimated_sigma_n",
)  # fmt: skip


def axis_name_mistake(name: str) -> str:
    """What is wrong with a name, "" for nothing."""
    if not _NAME.fullmatch(name):
        return f"name {name!r}: allowed are letters, digits and _, beginning with a letter"
    if name in _COORDINATES:
        return f"{name!r} is a coordinate of the tip in trajectory columns; choose another name"
    if name in _RECORDED:
        return f"{name!r} is another value of the robot in recordings; choose another name"
    return ""
