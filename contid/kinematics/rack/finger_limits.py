"""Limits of a two-rack finger (Morita et al., Eq. 8) in arc length S and commanded curvature k.

Eq. 8 as printed bounds k; both bending signs are meant, so |k| is bounded here. For one S the feasible
curvatures are an interval ``|k| <= K(S)``::

    K(S) = min( k_max/gain(S),  2 (L_max/S - 1)/w,  2 (1 - L_min/S)/w,  2 pi/(S gain(S)) )

k_max bounds the *actual* curvature (links touch), the racks bound the *commanded* one. Beyond a full turn,
where a slender finger meets its own base, the inverse would not be unique. The region is the band between -K
and K over S in [S_min, L_max]; the nearest reachable point is searched along its boundary, two curves and one
edge (``contid/kernels/finger/boundary.hpp``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from contid.targets import Actuation
from contid.units import m_to_mm

# Rounding of the closed form, relative: a target exactly on a limit is inside it.
_ROUNDING: Final = 1e-12
# Intervals of the even samples along a side of the boundary.
_COARSE: Final = 96
# Between two samples the tip turns by less [rad]: a slender finger turns by 2 pi where its racks begin to
# bind, within a hundredth of an interval.
_TURN: Final = 0.4
# Corners within an interval: the bound is one of four.
_CORNERS: Final = 4
# Halves the distance of two samples to the last bits of the parameter.
_BISECTIONS: Final = 45


@dataclass(frozen=True, slots=True)
class RackFingerEnvelope:
    """Limits of one finger.

    Attributes:
        rack_spacing_m: w of Eq. 1.
        length_min_m, length_max_m: range of both racks.
        curvature_max_per_m: maximum actual curvature, either sign.
        arc_length_min_m: minimum S; towards S = 0 the curvature of a point is ill-conditioned.
        curvature_gain: actual over commanded curvature at an arc length.
        pieces: samples along a side of the boundary, in pieces without a corner.
    """

    rack_spacing_m: float
    length_min_m: float
    length_max_m: float
    curvature_max_per_m: float
    arc_length_min_m: float
    curvature_gain: Callable[[float], float]
    pieces: tuple[tuple[float, ...], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Find the samples, with which the search for the nearest point starts."""
        pieces, piece = [], [0.0]
        for low, high in pairwise(i / _COARSE for i in range(_COARSE + 1)):
            for _ in range(_CORNERS):
                if self._limit(low) == self._limit(high):
                    break
                corner = self._corner(low, high)
                pieces.append((*piece, *self._between(low, corner), corner))
                piece, low = [corner], corner
            piece += [*self._between(low, high), high]
        object.__setattr__(self, "pieces", (*pieces, tuple(piece)))

    def racks(self, arc_length_m: float, commanded_per_m: float) -> tuple[float, float]:
        """Lengths of the left and the right rack [m]: ``L = S (1 -+ k w/2)``."""
        bend = 0.5 * self.rack_spacing_m * commanded_per_m * arc_length_m
        return arc_length_m - bend, arc_length_m + bend

    def exceeded(self, arc_length_m: float, curvature_per_m: float) -> dict[str, str]:
        """Limits an arc exceeds: name -> sentence with the excess; empty when it is feasible."""
        found: dict[str, str] = {}
        if arc_length_m < self.arc_length_min_m * (1.0 - _ROUNDING):
            found["arc_length.min"] = (
                f"arc length {m_to_mm(arc_length_m):.6g} mm is below {m_to_mm(self.arc_length_min_m):.6g} mm"
            )
        if abs(curvature_per_m) > self.curvature_max_per_m * (1.0 + _ROUNDING):
            found["curvature"] = (
                f"curvature {abs(curvature_per_m) / 1e3:.6g} /mm is above "
                f"{self.curvature_max_per_m / 1e3:.6g} /mm"
            )
        slack = _ROUNDING * self.length_max_m
        racks = self.racks(arc_length_m, curvature_per_m / self.curvature_gain(arc_length_m))
        for name, length in zip(("left", "right"), racks, strict=True):
            if length > self.length_max_m + slack:
                over = length - self.length_max_m
                found[f"{name}.max"] = f"{name} rack would be {m_to_mm(over):.6g} mm too long"
            if length < self.length_min_m - slack:
                under = self.length_min_m - length
                found[f"{name}.min"] = f"{name} rack would be {m_to_mm(under):.6g} mm too short"
        return found

    def snap(self, racks: tuple[float, float]) -> Actuation:
        """Feasible racks with their rounding error beyond the range removed."""
        return tuple([min(max(length, self.length_min_m), self.length_max_m) for length in racks])

    def curvature_bound(self, arc_length_m: float) -> float:
        """K(S): the maximum commanded curvature at an arc length."""
        return max(0.0, min(self._curvature_bounds(arc_length_m)))

    def _curvature_bounds(self, arc_length_m: float) -> tuple[float, float, float, float]:
        w, gain = self.rack_spacing_m, self.curvature_gain(arc_length_m)
        return (
            self.curvature_max_per_m / gain,
            2.0 * (self.length_max_m / arc_length_m - 1.0) / w,
            2.0 * (1.0 - self.length_min_m / arc_length_m) / w,
            2.0 * math.pi / (arc_length_m * gain),
        )

    def _arc_length(self, u: float) -> float:
        """From the minimum arc length at u = 0 to the maximum at 1."""
        least = max(self.arc_length_min_m, self.length_min_m)
        return least + u * (self.length_max_m - least)

    def _limit(self, u: float) -> int:
        """Index of the bound that determines K."""
        bounds = self._curvature_bounds(self._arc_length(u))
        return bounds.index(min(bounds))

    def _between(self, low: float, high: float) -> list[float]:
        """Further samples where the tip turns by more than `_TURN`, even in its direction."""
        ends = self._turn(low), self._turn(high)
        parts = math.ceil(abs(ends[1] - ends[0]) / _TURN)
        return [self._at_turn(low, high, ends[0] + (ends[1] - ends[0]) * i / parts) for i in range(1, parts)]

    def _turn(self, u: float) -> float:
        """Direction of the tip on the side of +K [rad]."""
        arc_length_m = self._arc_length(u)
        return arc_length_m * self.curvature_bound(arc_length_m) * self.curvature_gain(arc_length_m)

    def _at_turn(self, low: float, high: float, turn: float) -> float:
        """Where the tip has a direction, by bisection."""
        rises = self._turn(low) < turn
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if (self._turn(middle) < turn) == rises else (low, middle)
        return high

    def _corner(self, low: float, high: float) -> float:
        """Where another bound begins to determine K, by bisection."""
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._limit(middle) == self._limit(low) else (low, middle)
        return high

    def binding(self, racks: Actuation) -> tuple[str, ...]:
        """Names of the limits that bind at a feasible pair of racks."""
        left, right = racks
        slack = 1e-9 * self.length_max_m
        arc_length_m = 0.5 * (left + right)
        actual = abs(right - left) / (self.rack_spacing_m * arc_length_m) * self.curvature_gain(arc_length_m)
        touching = {
            "curvature": actual >= self.curvature_max_per_m * (1.0 - 1e-9),
            "full_turn": actual * arc_length_m >= 2.0 * math.pi * (1.0 - 1e-9),
            "arc_length.min": arc_length_m <= self.arc_length_min_m + slack,
            "left.max": left >= self.length_max_m - slack,
            "right.max": right >= self.length_max_m - slack,
            "left.min": left <= self.length_min_m + slack,
            "right.min": right <= self.length_min_m + slack,
        }
        return tuple(name for name, touches in touching.items() if touches)

    def _boundary(self) -> Iterator[Callable[[float], Actuation]]:
        """The boundary as curves over a parameter in [0, 1]."""

        def bent(sign: float) -> Callable[[float], Actuation]:
            def at(u: float) -> Actuation:
                arc_length_m = self._arc_length(u)
                return self.snap(self.racks(arc_length_m, sign * self.curvature_bound(arc_length_m)))

            return at

        yield bent(1.0)
        yield bent(-1.0)
        least = self._arc_length(0.0)
        widest = self.curvature_bound(least)
        yield lambda u: self.snap(self.racks(least, (2.0 * u - 1.0) * widest))

    def outline(self, points: int) -> Iterator[Actuation]:
        """Racks around the boundary in order: out along +K, back along -K, across at minimum S."""
        out, back, across = self._boundary()
        yield from (out(i / points) for i in range(points))
        yield from (back(1.0 - i / points) for i in range(points))
        yield from (across(i / points) for i in range(points))
