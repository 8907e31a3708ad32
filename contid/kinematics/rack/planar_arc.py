"""The planar circular arc without singularities: sinc, cosc and their derivatives.

    sinc(z) = sin(z)/z        cosc(z) = (1 - cos z)/z

An arc of length S and turning angle theta that starts along +y and bends towards +x ends at
``(S cosc(theta), S sinc(theta))``; the radius, infinite on the straight line, is never formed.
"""

from __future__ import annotations

import math
from typing import Final

# Below this |z| the closed forms lose digits to cancellation; four terms of the series leave < 1e-17.
_SERIES: Final = 1e-2
# The derivatives cancel one order earlier: (z cos z - sin z)/z^2 loses eps/z.
_SERIES_DERIVATIVE: Final = 0.1


def sinc(z: float) -> float:
    """``sin(z)/z``, 1 at 0."""
    if abs(z) < _SERIES:
        q = z * z
        return 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0))
    return math.sin(z) / z


def cosc(z: float) -> float:
    """``(1 - cos z)/z``, 0 at 0; through the half angle, so that small z keep their digits."""
    if abs(z) < _SERIES:
        q = z * z
        return z / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0)))
    half = math.sin(z / 2.0)
    return 2.0 * half * half / z


def sinc_derivative(z: float) -> float:
    """Derivative of sinc: (z cos z - sin z)/z^2."""
    if abs(z) < _SERIES_DERIVATIVE:
        q = z * z
        return -z / 3.0 * (1.0 - q / 10.0 * (1.0 - q / 28.0 * (1.0 - q / 54.0 * (1.0 - q / 88.0))))
    return (z * math.cos(z) - math.sin(z)) / (z * z)


def cosc_derivative(z: float) -> float:
    """Derivative of cosc: (z sin z - (1 - cos z))/z^2."""
    if abs(z) < _SERIES_DERIVATIVE:
        q = z * z
        return 0.5 * (1.0 - q / 4.0 * (1.0 - q / 18.0 * (1.0 - q / 40.0 * (1.0 - q / 70.0))))
    half = math.sin(z / 2.0)
    return (z * math.sin(z) - 2.0 * half * half) / (z * z)
