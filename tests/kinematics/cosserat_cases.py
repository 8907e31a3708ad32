"""The arm of the paper and the golden rows of the reference, for every test of the Cosserat model."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.solve import Limits
from studies.shi_experiments import segment

GOLDEN: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "reference" / "cosserat-golden.json").read_text(encoding="utf-8")
)
GRAM = 9.81e-3  # N

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


def limits(sections: int, top: float = 1.5) -> Limits:
    n = 3 * sections
    return Limits(np.zeros(n), np.full(n, top), np.full(n, 0.5 * top))


def lean(point: Array, degrees: float) -> Array:
    """Tip direction tilted outward by an angle in the radial plane, twist-free (reference, section 2b)."""
    azimuth, tilt = math.atan2(point[1], point[0]), math.radians(degrees)
    return np.array([math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth), math.cos(tilt)])
