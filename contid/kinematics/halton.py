"""Halton points, evenly spread in the unit cube."""

from __future__ import annotations

from typing import Final

#: One base per coordinate.
PRIMES: Final = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89)


def radical_inverse(index: int, base: int) -> float:
    """Van der Corput's sequence in [0, 1): digits of the index mirrored at the point (Halton 1960)."""
    value, scale = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value += digit * scale
        scale /= base
    return value
