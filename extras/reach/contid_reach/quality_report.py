"""Numbers of quality maps: quantiles with the places that have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from contid.units import MM_PER_M
from contid_reach.quality import UNITS, QualityMap

#: Share of the places with less, by name.
_SHARES: Final = {"least": 0.0, "median": 0.5, "p95": 0.95, "greatest": 1.0}


def to_text(maps: Mapping[str, QualityMap]) -> Iterator[str]:
    """Lines per robot."""
    for name, found in maps.items():
        unit = UNITS[found.measure][0]
        where = "squares" if found.planar else "voxels"
        yield f"{name}: {found.measure} at {len(found.values)} {where} of {found.edge_m * MM_PER_M:.3g} mm"
        for share, (value, place) in _quantiles(found).items():
            x, y, z = (f"{each:.0f}" for each in place)
            at = f"({x}, {y})" if found.planar else f"({x}, {y}, {z})"
            yield f"  {share:8} {f'{value:.3g} {unit}':14} near {at} mm"
        if unknown := int(np.isnan(found.values).sum()):
            yield f"  unknown at {unknown} of them: no stable equilibrium"


def to_json(maps: Mapping[str, QualityMap]) -> dict[str, object]:
    """The numbers for ``--json``, with the whole map."""
    (measure,) = {found.measure for found in maps.values()}
    return {
        "quality": str(measure),
        "unit": UNITS[measure][0],
        "robots": {
            name: {
                **{share: value for share, (value, _) in _quantiles(found).items()},
                "edge_mm": found.edge_m * MM_PER_M,
                "points_mm": (found.points_m * MM_PER_M).tolist(),
                "values": [None if np.isnan(value) else value for value in found.values.tolist()],
            }
            for name, found in maps.items()
        },
    }


def _quantiles(found: QualityMap) -> dict[str, tuple[float, tuple[float, ...]]]:
    out: dict[str, tuple[float, tuple[float, ...]]] = {}
    for name, share in _SHARES.items():
        value = found.quantile(share)
        out[name] = value, tuple(each * MM_PER_M for each in found.place_of(value))
    return out
