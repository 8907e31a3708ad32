"""The frame of a table: origin, axes, handedness and scale, or a rigid fit to known points.

``p_robot = at + scale * R (p_table - origin)``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from contid.errors import ContidError
from contid_adapt.meaning.mapping import Mapping, number_of
from contid_adapt.meaning.values import Values
from contid_adapt.placing.rigid_fit import Floats, rigid_fit

_KEYS: Final = ("x", "y", "z", "up", "origin", "at", "scale", "mirrored", "fit", "within_mm")
_HELP: Final = (
    "write `frame: robot` (the numbers lie in the world frame of the robot file), or `frame: {up: y, "
    "origin: rest, at: rest}`, or `frame: axes` for columns of axes; without it nothing is written"
)
#: Rows of the robot's x, y, z in the axes of the table, by which of them is up.
_UP: Final = {
    "z": ("x", "y", "z"), "-z": ("x", "-y", "-z"), "y": ("x", "-z", "y"), "-y": ("x", "z", "-y"),
    "x": ("y", "z", "x"), "-x": ("y", "-z", "-x"),
}  # fmt: skip
_REST_S: Final = 0.2
_STILL_MM: Final = 1.0
_WITHIN_MM: Final = 2.0
_NAME: Final = re.compile(r"^(?P<prefix>.*?)(?P<kind>a|b|load\.f)?(?P<axis>[xyz])(?P<unit>_mm|_n)?$")


@dataclass(frozen=True, slots=True)
class TableFrame:
    """From the table to the world of the robot.

    Attributes:
        turn: shape ``(3, 3)``, rows are the robot's axes in those of the table; a mirror has determinant -1.
        scale: of lengths.
        origin_mm, at_mm: a point of the table and where it lies in the world.
        shown: what was found, for the report.
    """

    turn: Floats
    scale: float
    origin_mm: Floats
    at_mm: Floats
    shown: str

    def points(self, points: Floats) -> Floats:
        """Positions in the world, shape ``(n, 3)`` [mm]."""
        found: Floats = self.at_mm + self.scale * (points - self.origin_mm) @ self.turn.T
        return found


def read_frame(
    mapping: Mapping, values: Values, times: Floats, rest_mm: Floats | None, prefix: str
) -> TableFrame:
    """Interpret the frame of a mapping.

    Args:
        mapping: parsed.
        values: of the table.
        times: of its rows [s].
        rest_mm: the tip of the robot at rest in the world, None where the robot takes no tip.
        prefix: of the columns of that robot.

    Raises:
        BadInputError: no frame, a mirror that is not stated, a fit that does not fit.
    """
    given = mapping.frame
    positions = any(name.endswith(("x_mm", "y_mm")) and _NAME.match(name) for name in values.names)
    if given is None or given == "":
        raise mapping.wrong("frame", f"no frame; {_HELP}")
    try:
        if given == "axes" and not positions:
            return TableFrame(np.eye(3), 1.0, np.zeros(3), np.zeros(3), "columns of axes: no frame")
        if given == "robot":
            given = {}
        if not isinstance(given, dict):
            raise ContidError(f"a frame of positions; {_HELP}")
        if unknown := [key for key in given if key not in _KEYS]:
            raise ContidError(f"{unknown[0]!r} is no key of a frame; allowed: {', '.join(_KEYS)}")
        tips = _tips(values, prefix)
        return _fitted(given, values) if "fit" in given else _stated(given, values, times, rest_mm, tips)
    except ContidError as error:
        raise mapping.wrong("frame", str(error)) from error


def place(frame: TableFrame, values: Values) -> Floats:
    """Rows in the world of the robot: positions moved and turned, directions and forces turned."""
    rows = values.rows.copy()
    groups: dict[tuple[str, str], dict[str, int]] = {}
    for at, name in enumerate(values.names):
        found = _NAME.match(name)
        if found and (found["kind"] or found["unit"] == "_mm"):
            groups.setdefault((found["prefix"], found["kind"] or ""), {})[found["axis"]] = at
    for (_, kind), places in groups.items():
        if "x" not in places or "y" not in places:
            continue
        vectors = np.zeros((len(rows), 3))
        for axis, at in places.items():
            vectors[:, "xyz".index(axis)] = values.rows[:, at]
        moved = vectors @ frame.turn.T if kind else frame.points(vectors)
        for axis, at in places.items():
            rows[:, at] = moved[:, "xyz".index(axis)]
    return rows


def _tips(values: Values, prefix: str) -> Floats:
    """The tip of the robot in the table, shape ``(n, 3)``."""
    points = np.zeros((len(values.rows), 3))
    for place, axis in enumerate("xyz"):
        name = f"{prefix}{axis}_mm"
        if name in values.names:
            points[:, place] = values.rows[:, values.names.index(name)]
    return points


def _stated(
    given: dict[str, Any], values: Values, times: Floats, rest_mm: Floats | None, tips: Floats
) -> TableFrame:
    axes = ["x", "y", "z"]
    if "up" in given:
        if given["up"] not in _UP or {"x", "y", "z"} & given.keys():
            raise ContidError("`up` is one of x, y, z, -x, -y, -z, and stands without x, y, z")
        axes = list(_UP[given["up"]])
    axes = [str(given.get(axis, own)) for axis, own in zip("xyz", axes, strict=True)]
    turn = np.zeros((3, 3))
    for row, axis in enumerate(axes):
        if axis.lstrip("+-") not in ("x", "y", "z"):
            raise ContidError(f"{'xyz'[row]}: {axis!r} is none of x, y, z, -x, -y, -z of the table")
        turn[row, "xyz".index(axis.lstrip("+-"))] = -1.0 if axis.startswith("-") else 1.0
    if abs(np.linalg.det(turn)) < 0.5:
        raise ContidError(f"the axes {', '.join(axes)} are not three different ones")
    mirror = bool(np.linalg.det(turn) < 0.0) != values.mirrored
    required = str(given.get("mirrored", "no")).lower() in ("yes", "true")
    if mirror and not required:
        raise ContidError(
            "the signs and axes turn a right hand into a left one: one sign is wrong, or the table is "
            "left-handed, then write `mirrored: yes` in the frame"
        )
    if required and not mirror:
        raise ContidError("`mirrored: yes`, but the signs and axes mirror nothing")
    scale = number_of(given.get("scale", "1"), "scale")
    if scale <= 0.0:
        raise ContidError("scale is greater than 0")
    origin, note = _origin(given.get("origin", ["0", "0", "0"]), times, tips)
    at = given.get("at", ["0", "0", "0"])
    if at == "rest":
        if rest_mm is None:
            raise ContidError("`at: rest`, but the robot takes no tip")
        at_mm = rest_mm
    else:
        at_mm = _vector(at, "at")
    shown = f"x, y, z are {', '.join(axes)} of the table" + (f", scale {scale:g}" if scale != 1.0 else "")
    where = ", ".join(f"{value:.3f}" for value in origin), ", ".join(f"{value:.3f}" for value in at_mm)
    return TableFrame(
        turn, scale, origin, at_mm, f"{shown}; ({where[0]}) mm of it lies at ({where[1]}) mm{note}"
    )


def _origin(given: Any, times: Floats, tips: Floats) -> tuple[Floats, str]:
    if given == "first":
        return tips[0], ", its first row"
    if given != "rest":
        return _vector(given, "origin"), ""
    behind = np.searchsorted(times, times + _REST_S)
    for row, end in enumerate(behind):
        if end >= len(times) or end - row < 3:
            continue
        part = tips[row:end]
        centre = np.median(part, axis=0)
        far = np.linalg.norm(part - centre, axis=1)
        if far.max() <= _STILL_MM:
            rms = float(np.sqrt(np.mean(far**2)))
            return centre, f", its rest from {times[row]:.3f} s (residual {rms:.3f} mm rms)"
    raise ContidError(
        f"`origin: rest`, but the tip never rests for {_REST_S:g} s within {_STILL_MM:g} mm; "
        "write `origin: first`, or three numbers"
    )


def _vector(given: Any, what: str) -> Floats:
    if not isinstance(given, list) or len(given) not in (2, 3):
        raise ContidError(f"{what} is rest, or numbers [x, y, z] in mm" + (", or first" * (what == "origin")))
    numbers = [number_of(each, what) for each in given]
    return np.array([*numbers, *[0.0] * (3 - len(numbers))])


def _fitted(given: dict[str, Any], values: Values) -> TableFrame:
    pairs = given["fit"]
    if (
        not isinstance(pairs, list)
        or len(pairs) < 3
        or any(not isinstance(e, list) or len(e) != 6 for e in pairs)
    ):
        raise ContidError(
            "fit is a list of three and more [x, y, z of the table, x, y, z of the robot], in mm"
        )
    if extra := [key for key in given if key not in ("fit", "within_mm")]:
        raise ContidError(f"a fit finds everything itself; {extra[0]!r} stands beside it")
    table = np.array([[number_of(each, "fit") for each in pair] for pair in pairs])
    found = rigid_fit(table[:, :3], table[:, 3:])
    if found is None:
        raise ContidError("the points of the fit lie on a line; a plane at least is needed")
    turn, origin, at, rms = found
    within = number_of(given.get("within_mm", str(_WITHIN_MM)), "within_mm")
    if rms > within:
        raise ContidError(
            f"the points fit with {rms:.3g} mm rms only; allowed are {within:g} mm (`within_mm:`)"
        )
    if values.mirrored:
        raise ContidError("the signs of the mapping turn a right hand into a left one; a rigid fit cannot")
    return TableFrame(turn, 1.0, origin, at, f"rigid fit to {len(pairs)} points, residual {rms:.3g} mm rms")
