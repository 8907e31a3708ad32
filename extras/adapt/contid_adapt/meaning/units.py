"""Units that tables state, and what one of them is in the units of trajectories (s, mm, deg, bar, n)."""

from __future__ import annotations

import math
import re
from typing import Final

#: Unit -> its kind, and how many of the unit of trajectories one of it is.
UNITS: Final[dict[str, tuple[str, float]]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "ns": ("s", 1e-9), "min": ("s", 60.0),
    "mm": ("mm", 1.0), "m": ("mm", 1e3), "cm": ("mm", 10.0), "um": ("mm", 1e-3), "in": ("mm", 25.4),
    "deg": ("deg", 1.0), "rad": ("deg", 180.0 / math.pi),
    "bar": ("bar", 1.0), "mbar": ("bar", 1e-3), "pa": ("bar", 1e-5), "kpa": ("bar", 1e-2),
    "mpa": ("bar", 10.0), "millipascal": ("bar", 1e-8), "psi": ("bar", 0.0689475729),
    "atm": ("bar", 1.01325),
    "n": ("n", 1.0), "mn": ("n", 1e-3), "kn": ("n", 1e3), "meganewton": ("n", 1e6),
}  # fmt: skip
#: Symbols by which the case decides between milli and mega. Every other symbol has one meaning in any case:
#: ``mpa`` and ``MPA`` are megapascals, ``mn`` and ``Mn`` millinewtons.
_CASED: Final = {"mPa": "millipascal", "MN": "meganewton"}
_SPELLINGS: Final = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millis": "ms",
    "milliseconds": "ms", "usec": "us", "microseconds": "us", "µs": "us", "nsec": "ns", "nsecs": "ns",
    "nanosec": "ns", "nanoseconds": "ns", "nanosecs": "ns", "minutes": "min",
    "meter": "m", "meters": "m", "metre": "m", "metres": "m", "millimeter": "mm", "millimeters": "mm",
    "millimetres": "mm", "centimeters": "cm", "centimetres": "cm", "inch": "in", "inches": "in",
    "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad", "newton": "n",
}  # fmt: skip
#: The last word of a name, behind ``_``, ``.`` or a space, or the whole name.
_LAST_WORD: Final = re.compile(r"(?:^|[_. ])([A-Za-z]+)$")
#: Symbols that are no units at the end of a name, only in brackets and in a line of units.
_NOT_IN_NAMES: Final = ("in", "n")
#: Names of times: only at the end of these ``min`` is minutes; elsewhere it is a minimum (``x_min``).
_TIME_NAME: Final = re.compile(r"time|stamp|elapsed|duration|^t_", re.IGNORECASE)
_IN_BRACKETS: Final = re.compile(r"^(.*?)\s*[\[(]\s*([^\[\]()]*)\s*[\])]\s*$")


def unit_word(text: str) -> str:
    """The short form of a unit in brackets or alone; what is none comes back in lower case."""
    bare = text.strip().strip("[]()").strip()
    if bare in _CASED:
        return _CASED[bare]
    return _SPELLINGS.get(bare.lower(), bare.lower())


def name_and_unit(name: str) -> tuple[str, str]:
    """A name without its unit in brackets, and the unit; "" for none, and for empty brackets.

    Empty brackets stand behind numbers without a unit: ``q_RS_w []``.
    """
    found = _IN_BRACKETS.match(name)
    if found and found[1] and (unit_word(found[2]) in UNITS or not found[2].strip()):
        return found[1], unit_word(found[2])
    return name, ""


def unit_of_name(name: str) -> str:
    """The unit at the end of a name: ``t_ms``, ``x_m``, ``stamp.nsecs``; "" for none.

    Behind ``_`` symbols and spelled units count. Behind ``.`` or a space, and where the whole name is one
    word, only spelled units of more than three letters do: ``p.m`` and ``x`` have no unit.
    """
    found = _LAST_WORD.search(name)
    if not found:
        return ""
    word = found[1]
    if name[found.start()] == "_":
        unit = unit_word(word)
    else:
        unit = _SPELLINGS.get(word.lower(), "") if len(word) > 3 else ""
    if unit not in UNITS or unit in _NOT_IN_NAMES:
        return ""
    if word.lower() == "min" and not _TIME_NAME.search(name):
        return ""
    return unit


def factor_to(unit: str, required: str) -> float | None:
    """How many of the required unit one of a unit is; None for other kinds."""
    kind = UNITS.get(unit)
    return (
        kind[1] / UNITS[required][1] if kind and required in UNITS and kind[0] == UNITS[required][0] else None
    )
