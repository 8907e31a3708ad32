"""The arm of the paper and the golden rows of the reference, for every test of the Cosserat model."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import Limits, RodSetup, RodSolver
from contid.kinematics.cosserat.section import Loads, Rod
from studies.shi_experiments import segment

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "reference" / "cosserat-golden.json").read_text(encoding="utf-8")
)
GRAM = 9.81e-3  # N
#: An error that asks for no doubling of elements [mm].
NEVER_MM = 1e9

section = segment


def one(kind: int = 0, link: float = 0.0) -> Rod:
    return Rod((section(kind, link),))


def two(tip_link: float = 0.0) -> Rod:
    return Rod((section(0, 5.0), section(1, tip_link)))


def rod_of(case: dict[str, Any]) -> Rod:
    return two() if len(case["P"]) == 6 else one(case["seg0"])


def loads_of(case: dict[str, Any], sections: int) -> Loads:
    given = {key: np.array(value, float) for key, value in case["loads"].items()}
    zero = np.zeros(3)
    return Loads(
        tip_force=given.get("Ftip", zero),
        tip_moment=given.get("mtip", zero),
        joint_force={0: given["Fmid"]} if "Fmid" in given else {},
        joint_moment={0: given["mmid"]} if "mmid" in given else {},
        weight=dict.fromkeys(range(sections), given["w"]) if "w" in given else {},
        link_weight={0: given["wl"]} if "wl" in given else {},
    )


def hanging(grams: float) -> Loads:
    """A weight on the tip of an arm that hangs tip down."""
    return Loads(tip_force=np.array([0.0, 0.0, grams * GRAM]))


def solver(rod: Rod, weight: Loads | None = None, **settings: Any) -> RodSolver:
    """Of a rod whose elements are never doubled and whose searches are short, but for ``settings``."""
    usual: dict[str, Any] = {"elements": 3, "error": NEVER_MM, "tolerance": 1e-6, "direction_length": 42.0}
    usual |= {"limits": limits(len(rod.sections)), "full_rotation": False, "thorough": False}
    return RodSolver(RodSetup(rod, weight or Loads(), **{**usual, **settings}))


@dataclass(frozen=True)
class Standing:
    """An equilibrium by the kernel: part of the loads carried, base moment [N·mm], places [mm], frame."""

    carried: float
    moment: Array
    tip: Array
    ends: Array
    rotation: Array
    elements: int


def standing(
    rod: Rod, pressures: Array, loads: Loads, elements: int = 3, error: float = NEVER_MM
) -> Standing:
    """Where the arm gets to under any loads, by `RodSolver.statics`."""
    ends, begin = [], 0.0
    for each in rod.sections:
        ends.append(begin + each.length)
        begin = ends[-1] + each.link
    frames = np.empty((len(ends) + 1, 12))
    solved = solver(rod, elements=elements, error=error)
    found = solved.statics(list(pressures), loads, np.array([*ends, rod.reach]), frames)
    tip, rotation = frames[-1, :3], frames[-1, 3:].reshape(3, 3)
    moment = np.array(found.base_moment_nmm)
    return Standing(found.carried, moment, tip, frames[:-1, :3], rotation, found.elements)


def limits(sections: int, top: float = 1.5) -> Limits:
    n = 3 * sections
    return Limits(np.zeros(n), np.full(n, top), np.full(n, 0.5 * top))


def lean(point: Array, degrees: float) -> Array:
    """Tip direction tilted outward by an angle in the radial plane, twist-free (reference, section 2b)."""
    azimuth, tilt = math.atan2(point[1], point[0]), math.radians(degrees)
    return np.array([math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)])
