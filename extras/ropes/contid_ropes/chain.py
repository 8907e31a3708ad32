"""Two arms and the rope between their tips: the shape of the rope, and whether it is feasible.

The rope is a catenary between the tips (pinned ends) or a Pythagorean-hodograph curve of its length between
the tips' directions (clamped ends). Without its length the mean error of the curve is some 20 mm per metre.

Source: Singh et al., IROS 2018, section on the closed chain. Their link 3 runs from the tip to the base, so
its directions are the negatives of the second arm's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kernels import load
from contid.kinematics.array import Array
from contid.robot_file.chain import Chain
from contid.targets import Tip, Vec3
from contid.units import MM_PER_M, STANDARD_GRAVITY, m_to_mm
from contid_ropes.catenary import Catenary, as_quintic, hang
from contid_ropes.ph.ends import CurveEnds, PhFit, through
from contid_ropes.ph.quintic import points_at

#: The sag found among as many samples of a quintic has an error below 0.1 %.
_SAMPLES: Final = 129


@dataclass(frozen=True, slots=True)
class ChainState:
    """State of the rope between two tips.

    Attributes:
        feasible: long enough, and above the floor.
        margin_m: height of the lowest point above the floor [m]; when the rope is too short, minus the
            missing length.
        lowest: the rope's lowest point in the world [m]; None when it is too short.
        reason: why it is not feasible, "" when it is.
        pull_n: tension at the first and the second tip [N]; None unless it is pinned, of known mass, and not
            taut.
    """

    feasible: bool
    margin_m: float
    lowest: Vec3 | None
    reason: str = ""
    pull_n: tuple[float, float] | None = None


class ChainGuard:
    """Checks the rope of a chain for given tips of its arms."""

    def __init__(self, name: str, chain: Chain) -> None:
        self.name = name
        self.arms = chain.arms
        self._rope = chain.rope
        self._length_m = chain.rope.length_mm / MM_PER_M
        self._floor_m = chain.floor_m
        self._kernel = load("ph_curve")

    def check(self, tips: Mapping[str, Tip]) -> ChainState:
        """The state of the chain for the poses of its arms; other entries are ignored."""
        (start, _), (end, _) = (tips[arm] for arm in self.arms)
        hanging = hang(start, end, self._length_m)
        if hanging is None:
            short_m = math.dist(start, end) - self._length_m
            arms = " and ".join(self.arms)
            message = f"the rope is {m_to_mm(short_m):.6g} mm too short between {arms}"
            return ChainState(False, -short_m, None, message)
        lowest = hanging.lowest if self._rope.ends == "pinned" else self._lowest(self._ends(tips, hanging))
        pull = None
        if self._rope.mass_g is not None and self._rope.ends == "pinned" and not hanging.taut:
            pull = hanging.pull_n(self._rope.mass_g * 1e-3 * STANDARD_GRAVITY)
        margin_m = lowest[2] - self._floor_m
        if margin_m < 0.0:
            below = f"{m_to_mm(-margin_m):.6g} mm below its floor ({m_to_mm(self._floor_m):g} mm)"
            return ChainState(False, margin_m, lowest, f"the rope hangs {below}", pull)
        return ChainState(True, margin_m, lowest, "", pull)

    def curves(self, tips: Mapping[str, Tip]) -> tuple[PhFit, ...]:
        """The rope as one or two quintics from the first tip to the second; none when it is too short.

        Two pieces share the direction at their joint, not the size of the derivative (G1, not C1).
        """
        (start, _), (end, _) = (tips[arm] for arm in self.arms)
        hanging = hang(start, end, self._length_m)
        return () if hanging is None else self._pieces(tips, hanging)

    def points(self, tips: Mapping[str, Tip], count: int) -> Array:
        """Points of the rope at equal arc length [m], shape ``(count, 3)``; empty when it is too short."""
        pieces = [fit.curve for fit in self.curves(tips)]
        if not pieces:
            return np.empty((0, 3))
        return points_at(pieces, np.linspace(0.0, sum(piece.length_m for piece in pieces), count))

    def _pieces(self, tips: Mapping[str, Tip], hanging: Catenary) -> tuple[PhFit, ...]:
        if self._rope.ends == "pinned" and self._rope.pieces == 1:
            return (as_quintic(hanging),)
        return tuple(through(ends, length_m) for ends, length_m in self._ends(tips, hanging))

    def _ends(self, tips: Mapping[str, Tip], hanging: Catenary) -> tuple[tuple[CurveEnds, float], ...]:
        """Ends and length [m] of every piece."""
        pinned, one = self._rope.ends == "pinned", self._rope.pieces == 1
        (start, leaving), (end, entering) = (tips[arm] for arm in self.arms)
        x, y, z = entering
        first = hanging.start_direction if pinned else leaving
        last = hanging.end_direction if pinned else (-x, -y, -z)
        if one:
            return ((CurveEnds(start, end, first, last), self._length_m),)
        half = 0.5 * self._length_m
        middle, along = hanging.at(half), hanging.direction_at(half)
        return (
            (CurveEnds(start, middle, first, along), half),
            (CurveEnds(middle, end, along, last), half),
        )

    def _lowest(self, pieces: tuple[tuple[CurveEnds, float], ...]) -> Vec3:
        """The lowest point of a clamped rope; the kernel takes microseconds, as the tick needs."""
        found: list[Vec3] = []
        for ends, length_m in pieces:
            (x0, y0, z0), (x1, y1, z1) = ends.start_m, ends.end_m
            chord = (x1 - x0, y1 - y0, z1 - z0)
            x, y, z = self._kernel.lowest(
                *chord, *_unit(ends.start_direction), *_unit(ends.end_direction), length_m, _SAMPLES
            )
            found.append((x0 + x, y0 + y, z0 + z))
        return min(found, key=lambda point: point[2])


def _unit(direction: Vec3) -> Vec3:
    x, y, z = direction
    size = math.hypot(x, y, z)
    return (x / size, y / size, z / size)
