"""The trajectories of Shi et al.'s experiments 1-4, with the heights the paper does not print.

Formulae and heights: shapes as in the figures' captions, centred on the arm's axis; heights are inside what
the model reaches at 1.5 bar (docs/robots/stiffflop.md). Lengths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array


@dataclass(frozen=True, slots=True)
class Run:
    """One trajectory of one experiment.

    Attributes:
        experiment: its number in the paper.
        name: as the paper calls it.
        segments: which ones the arm has (0 and 1 are the paper's 1 and 2).
        tip: points, shape (n, 3).
        mid: points of the mid-point, or None.
        lean_deg: outward tilt of the tip, or None for no direction.
        grams: mass on the tip.
        paper: the results printed in the paper.
    """

    experiment: int
    name: str
    segments: tuple[int, ...]
    tip: Array
    mid: Array | None = None
    lean_deg: float | None = None
    grams: float = 0.0
    paper: str = ""

    @property
    def direction(self) -> Array | None:
        """Tip direction along the run, shape (n, 3): the azimuth of the point, tilted, twist-free."""
        if self.lean_deg is None:
            return None
        azimuth, lean = np.arctan2(self.tip[:, 1], self.tip[:, 0]), np.radians(self.lean_deg)
        out = np.sin(lean)
        return np.stack(
            [out * np.cos(azimuth), out * np.sin(azimuth), np.full(len(azimuth), np.cos(lean))], axis=1
        )


def _tau(points: int) -> Array:
    return np.linspace(0.0, 1.0, points)


def ellipse(points: int, a: float, height: float, dz: float = 0.0, ratio: float = 2.0 / 3.0) -> Array:
    """An ellipse with semi-axes (a, ratio a); its height swings once by dz; shape (points, 3) [mm]."""
    phi = 2.0 * np.pi * _tau(points)
    z = height + dz * (1.0 - np.cos(phi)) / 2.0
    return np.stack([a * np.cos(phi), ratio * a * np.sin(phi), z], axis=1)


def square(points: int, side: float, height: float, dz: float = 0.0) -> Array:
    """A square at constant speed per edge; with dz the paper's box; shape (points, 3) [mm]."""
    corners = 0.5 * side * np.array([(1, -1), (1, 1), (-1, 1), (-1, -1), (1, -1)])
    along = 4.0 * _tau(points)
    edge = np.minimum(along.astype(int), 3)
    share = (along - edge)[:, None]
    plane = corners[edge] * (1.0 - share) + corners[edge + 1] * share
    return np.column_stack([plane, height + dz * (1.0 - np.cos(2.0 * np.pi * _tau(points))) / 2.0])


def spiral(points: int, radius: float, height: float, dz: float = 0.0) -> Array:
    """Three turns from the centre outward, rising by dz; shape (points, 3) [mm]."""
    tau = _tau(points)
    phi = 6.0 * np.pi * tau
    return np.stack([radius * tau * np.cos(phi), radius * tau * np.sin(phi), height + dz * tau], axis=1)


def line(points: int, length: float, height: float) -> Array:
    """A line of this length along x, there and back; shape (points, 3) [mm]."""
    tau = _tau(points)
    return np.stack([0.5 * length * np.cos(2.0 * np.pi * tau), 0.0 * tau, height + 0.0 * tau], axis=1)


def runs(points: int) -> list[Run]:
    """Every trajectory of experiments 1-4."""
    found = []
    one = "medians 1.40-2.89, max < 5.0 mm"
    shapes: list[tuple[str, Array]] = [
        *((f"square {s}", square(points, s, 50.0)) for s in (30, 40)),
        *((f"ellipse {s}", ellipse(points, s, 50.0)) for s in (15, 20)),
        *((f"spiral {s}", spiral(points, s, 50.0)) for s in (18, 24)),
        *((f"box {s} dz 10", square(points, s, 50.0, 10.0)) for s in (15, 20)),
        *((f"ellipse {s} dz 10", ellipse(points, s, 50.0, 10.0)) for s in (15, 20)),
        *((f"spiral {s} dz 10", spiral(points, s, 50.0, 10.0)) for s in (15, 21)),
    ]
    for segment in (0, 1):
        found += [
            Run(1, f"{name}, segment {segment + 1}", (segment,), tip, paper=one) for name, tip in shapes
        ]
    both = (0, 1)
    circle = ellipse(points, 30.0, 116.0, ratio=1.0)
    with_mid = [
        ("S20C30", circle, square(points, 20.0, 60.0), "tip median 2.36, max < 5.0 mm"),
        ("M0T27", spiral(points, 27, 116), spiral(points, 0, 60), "tip median 3.22 mm"),
        ("L15T27", spiral(points, 27, 118), line(points, 15, 60), "tip median 3.71, max 9.5 mm"),
        ("M12T27", spiral(points, 27, 116), spiral(points, 12, 60), "tip median 1.60, max < 5.0 mm"),
    ]
    found += [Run(2, name, both, tip, mid, paper=paper) for name, tip, mid, paper in with_mid]
    upright = [
        ("box", square(points, 30, 110, 20), "RMSE 2.83 mm, 3.4 deg"),
        ("ellipse", ellipse(points, 30, 110, 20), "RMSE 2.88 mm, 3.2 deg"),
        ("spiral", spiral(points, 30, 110, 20), "RMSE 3.03 mm, 2.4 deg"),
    ]
    found += [
        Run(3, f"{name} 30 dz 20, 0 deg", both, tip, lean_deg=0, paper=paper) for name, tip, paper in upright
    ]
    leaning = {
        0: "RMSE 2.32 mm, 2.0 deg",
        30: "RMSE 3.34 mm, 2.1 deg",
        45: "RMSE 2.91 mm, 2.6 deg",
        60: "RMSE 3.05 mm, 3.1 deg",
    }
    found += [
        Run(3, f"spiral 30, {lean} deg", both, spiral(points, 30, 120), lean_deg=lean, paper=paper)
        for lean, paper in leaning.items()
    ]
    two = "RMSE 2.0-3.5 mm, 1.5-2.5 deg; max < 7.0 mm, < 8.0 deg"
    for grams, flat, rising in ((0, "2.32", "2.12"), (5, "2.64", "1.94"), (10, "2.45", "1.85")):
        level, climbing = spiral(points, 24, 55), spiral(points, 21, 44, 10)
        found += [
            Run(4, f"spiral 24, {grams} g", (0,), level, grams=grams, paper=f"RMSE {flat} mm"),
            Run(4, f"spiral 21 dz 10, {grams} g", (0,), climbing, grams=grams, paper=f"RMSE {rising} mm"),
            Run(4, f"spiral 30, {grams} g", both, spiral(points, 30, 120), None, 0.0, grams, paper=two),
        ]
    return found
