"""Where a two-rack finger may go: Eq. 8 (with erratum A-4) in arc length S and commanded curvature k.

For one S the feasible curvatures are an interval ``|k| <= K(S)``::

    K(S) = min( k_max/gain(S),  2 (L_max/S - 1)/w,  2 (1 - L_min/S)/w )

k_max bounds the *actual* curvature (links touch), the racks bound the *commanded* one. The region is the band
between -K and K over S in [S_min, L_max]; its boundary is two curves and one edge, which makes the nearest
reachable point a search along lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from contid.targets import Actuation
from contid.units import m_to_mm

# Rounding of the closed form, relative: a target exactly on a limit is inside it.
_ROUNDING: Final = 1e-12
_COARSE: Final = 96
_INVERSE_GOLDEN: Final = (math.sqrt(5.0) - 1.0) / 2.0
# Golden section shrinks by 0.618 a step: 60 steps reach the last bits of the parameter.
_GOLDEN_STEPS: Final = 60


@dataclass(frozen=True, slots=True)
class RackFingerEnvelope:
    """Limits of one finger.

    Attributes:
        rack_spacing_m: w of Eq. 1.
        length_min_m, length_max_m: range of both racks.
        curvature_max_per_m: greatest actual curvature, either sign.
        arc_length_min_m: least S; towards S = 0 the curvature of a point is ill-conditioned.
        curvature_gain: actual over commanded curvature at an arc length.
    """

    rack_spacing_m: float
    length_min_m: float
    length_max_m: float
    curvature_max_per_m: float
    arc_length_min_m: float
    curvature_gain: Callable[[float], float]

    def racks(self, arc_length_m: float, commanded_per_m: float) -> tuple[float, float]:
        """``L = S (1 -+ k w/2)``."""
        bend = 0.5 * self.rack_spacing_m * commanded_per_m * arc_length_m
        return arc_length_m - bend, arc_length_m + bend

    def exceeded(self, arc_length_m: float, curvature_per_m: float) -> dict[str, str]:
        """Limits an arc breaks: name -> by how much, in words; empty when it is feasible."""
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
        """Remove the rounding by which a feasible answer may overstep its range."""
        return tuple(min(max(length, self.length_min_m), self.length_max_m) for length in racks)

    def curvature_bound(self, arc_length_m: float) -> float:
        """K(S): the greatest commanded curvature at an arc length."""
        w = self.rack_spacing_m
        return max(
            0.0,
            min(
                self.curvature_max_per_m / self.curvature_gain(arc_length_m),
                2.0 * (self.length_max_m / arc_length_m - 1.0) / w,
                2.0 * (1.0 - self.length_min_m / arc_length_m) / w,
            ),
        )

    def clamp(self, racks: Actuation) -> Actuation:
        """Nearest feasible racks in S, then in curvature; feasible racks come back untouched."""
        left, right = racks
        least = max(self.arc_length_min_m, self.length_min_m)
        arc_length_m = 0.5 * (left + right)
        if least <= arc_length_m <= self.length_max_m:
            commanded = (right - left) / (self.rack_spacing_m * arc_length_m)
            bound = self.curvature_bound(arc_length_m)
            if abs(commanded) <= bound * (1.0 + _ROUNDING):
                return self.snap((left, right))
        arc_length_m = min(max(arc_length_m, least), self.length_max_m)
        bound = self.curvature_bound(arc_length_m)
        commanded = (right - left) / (self.rack_spacing_m * arc_length_m)
        return self.snap(self.racks(arc_length_m, min(max(commanded, -bound), bound)))

    def binding(self, racks: Actuation) -> tuple[str, ...]:
        """Names of the limits that a feasible pair of racks touches."""
        left, right = racks
        slack = 1e-9 * self.length_max_m
        arc_length_m = 0.5 * (left + right)
        actual = abs(right - left) / (self.rack_spacing_m * arc_length_m) * self.curvature_gain(arc_length_m)
        touching = {
            "curvature": actual >= self.curvature_max_per_m * (1.0 - 1e-9),
            "arc_length.min": arc_length_m <= self.arc_length_min_m + slack,
            "left.max": left >= self.length_max_m - slack,
            "right.max": right >= self.length_max_m - slack,
            "left.min": left <= self.length_min_m + slack,
            "right.min": right <= self.length_min_m + slack,
        }
        return tuple(name for name, touches in touching.items() if touches)

    def _boundary(self) -> Iterator[Callable[[float], Actuation]]:
        """The boundary as curves over a parameter in [0, 1]."""
        least = max(self.arc_length_min_m, self.length_min_m)

        def bent(sign: float) -> Callable[[float], Actuation]:
            def at(u: float) -> Actuation:
                arc_length_m = least + u * (self.length_max_m - least)
                return self.snap(self.racks(arc_length_m, sign * self.curvature_bound(arc_length_m)))

            return at

        yield bent(1.0)
        yield bent(-1.0)
        widest = self.curvature_bound(least)
        yield lambda u: self.snap(self.racks(least, (2.0 * u - 1.0) * widest))

    def outline(self, points: int) -> Iterator[Actuation]:
        """Racks around the boundary, once and in order: out along +K, back along -K, across at least S."""
        out, back, across = self._boundary()
        yield from (out(i / points) for i in range(points))
        yield from (back(1.0 - i / points) for i in range(points))
        yield from (across(i / points) for i in range(points))

    def nearest(self, distance: Callable[[Actuation], float]) -> Actuation:
        """The point of the boundary with the least distance; ties go to the first curve, so it repeats."""
        best: tuple[float, Actuation] | None = None
        for curve in self._boundary():
            distances = [distance(curve(i / _COARSE)) for i in range(_COARSE + 1)]
            at = min(range(_COARSE + 1), key=distances.__getitem__)
            u = _golden_section(
                lambda u, curve=curve: distance(curve(u)),  # type: ignore[misc]  # binds the loop's curve
                max(at - 1, 0) / _COARSE,
                min(at + 1, _COARSE) / _COARSE,
            )
            found = min((distance(curve(u)), u), (distances[at], at / _COARSE))
            if best is None or found[0] < best[0]:
                best = (found[0], curve(found[1]))
        assert best is not None
        return best[1]


def _golden_section(of: Callable[[float], float], low: float, high: float) -> float:
    """Minimum of a unimodal function on an interval."""
    a, b = high - _INVERSE_GOLDEN * (high - low), low + _INVERSE_GOLDEN * (high - low)
    at_a, at_b = of(a), of(b)
    for _ in range(_GOLDEN_STEPS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _INVERSE_GOLDEN * (high - low)
            at_a = of(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _INVERSE_GOLDEN * (high - low)
            at_b = of(b)
    return 0.5 * (low + high)
