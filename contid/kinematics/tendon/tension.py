"""Tension of the tendons of a robot with constant bending stiffness and no load, and the pulls that keep it.

With tendons of stiffness k and sections of stiffness ``K = EI / L`` [N m/rad], pulls q (0 on the straight
robot at its pretension tau0) and bends Theta balance where the energy of both is least:

    tau = tau0 + k (q - G Theta),      G^T tau = K Theta      hence      Theta = (G^T k G + K)^-1 G^T k q.

The other way round, bends leave each section one number lambda [N] free: adding ``lambda n``, with ``n`` the
tensions that do not bend, relative to their mean (all 1 for even azimuths), tightens its tendons. Lambda is
chosen so that the smallest tension of the section is the floor: no tendon is slack, none is tighter than
necessary. Tensions are then piecewise linear and convex in the bends, so a limit of tension is a set of
planes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry

# Rounds of the search for tensions that do not bend; even the worst layout a robot file allows needs a few.
_ROUNDS = 10000


def balanced(arms: Array) -> Array | None:
    """Find tensions of the tendons of a section that do not bend it, relative to their mean.

    By alternating projections onto the null space of the moments and onto ``n >= 1/20``: with three tendons
    the null space has one direction, with evenly placed ones the answer is 1 everywhere.

    Args:
        arms: ``d (cos sigma, sin sigma)`` of each tendon [m], shape ``(tendons, 2)``.

    Returns:
        Positive tensions n, shape ``(tendons,)``, with mean 1 and ``arms^T n = 0``; None if there are none,
        because the tendons do not stand around the backbone.
    """
    onto_null_space = np.eye(len(arms)) - arms @ np.linalg.pinv(arms)
    n = onto_null_space @ np.ones(len(arms))
    for _ in range(_ROUNDS):
        mean = float(n.mean())
        if mean > 1e-9 and float(np.min(n)) >= 1e-3 * mean:
            return np.asarray(n / mean, dtype=np.float64)
        n = onto_null_space @ np.maximum(n, 0.05)
    return None


@dataclass(frozen=True, eq=False)
class TendonStatics:
    """Balance of tendons and backbone.

    Attributes:
        geometry: sections and tendons.
        bending_nm: K, bending stiffness of each section over its length [N m/rad].
        tendon_n_per_m: k, stiffness of each tendon [N/m], shape ``(tendons,)``.
        floor_n: least tension [N].
        limit_n: largest tension [N].
        slack_free: n, relative tensions that do not bend, shape ``(tendons,)``; mean 1 in each section.
        rest_n: tau0, tensions of the straight robot at zero pulls [N], shape ``(tendons,)``.
        demand: tensions per bend before any tightening [N/rad], shape ``(tendons, 2 sections)``; they may be
            negative.
        bends_by_pulls: matrix that turns pulls q into bends Theta [rad/m], shape ``(2 sections, tendons)``.
    """

    geometry: TendonGeometry
    bending_nm: tuple[float, ...]
    tendon_n_per_m: Array
    floor_n: float
    limit_n: float
    slack_free: Array = field(init=False)
    rest_n: Array = field(init=False)
    demand: Array = field(init=False)
    bends_by_pulls: Array = field(init=False)

    def __post_init__(self) -> None:
        geometry = self.geometry
        stiffness = np.repeat(self.bending_nm, 2)
        demand = np.zeros_like(geometry.pull_matrix)
        free = np.empty(geometry.tendons)
        for j, rows in enumerate(geometry.tendon_slices):
            arms = geometry.sections[j].arms
            n = balanced(arms)
            if n is None:
                raise ValueError(f"the tendons of section {j + 1} do not stand around the backbone")
            free[rows] = n
            # Moment by bends that the section's own tendons must give. Those that run through to sections
            # beyond give the moment of the next section, K Theta there: the own ones give the difference.
            moments = np.zeros((2, 2 * geometry.count))
            for k in range(j, min(j + 2, geometry.count) if geometry.through else j + 1):
                bends_of_k = slice(2 * k, 2 * k + 2)
                moments[:, bends_of_k] = (1.0 if k == j else -1.0) * np.diag(stiffness[bends_of_k])
            demand[rows] = np.linalg.pinv(arms.T) @ moments
        weighted = geometry.pull_matrix.T * self.tendon_n_per_m
        by_pulls = np.linalg.solve(weighted @ geometry.pull_matrix + np.diag(stiffness), weighted)
        for name, value in (("slack_free", free), ("demand", demand), ("bends_by_pulls", by_pulls)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "rest_n", self.tensions_of_bends(np.zeros(2 * geometry.count)))

    def tensions_of_bends(self, bends: Array, tightness: Array | float = 0.0) -> Array:
        """The tensions that hold bends and are nowhere below the floor.

        Args:
            bends: bends of the sections [rad], shape ``(2 sections,)``.
            tightness: lambda of each section above the least that the floor needs [N], shape ``(sections,)``.

        Returns:
            Tensions [N], shape ``(tendons,)``.
        """
        least: Array = self.demand @ bends
        lacks = np.maximum.reduceat((self.floor_n - least) / self.slack_free, self.geometry.first_of)
        tensions: Array = least + (lacks + tightness)[self.geometry.section_of] * self.slack_free
        return tensions

    def pulls(self, bends: Array, tightness: Array | float = 0.0) -> Array:
        """Pulls ``(tendons,)`` [m] that lead to bends [rad] with the tensions of `tensions_of_bends`."""
        stretch = (self.tensions_of_bends(bends, tightness) - self.rest_n) / self.tendon_n_per_m
        pulls: Array = self.geometry.pull_matrix @ bends + stretch
        return pulls

    def bends(self, pulls: Array) -> Array:
        """Bends ``(2 sections,)`` [rad] of any pulls ``(tendons,)`` [m] that keep all tendons taut."""
        bends: Array = self.bends_by_pulls @ pulls
        return bends

    def tensions(self, pulls: Array) -> Array:
        """Tensions ``(tendons,)`` [N] of pulls [m]; below 0 a tendon would have to push."""
        return self.tensions_at(pulls, self.bends(pulls))

    def tensions_at(self, pulls: Array, bends: Array) -> Array:
        """Tensions ``(tendons,)`` [N] of pulls [m] whose bends ``(2 sections,)`` [rad] are known."""
        stretch = pulls - self.geometry.pull_matrix @ bends
        tensions: Array = self.rest_n + self.tendon_n_per_m * stretch
        return tensions

    def pieces(self) -> list[tuple[int, Array, float]]:
        """Tendon, row and offset of every linear function of the bends whose maximum is its tension [N]."""
        out = []
        for rows in self.geometry.tendon_slices:
            for tendon in range(rows.start, rows.stop):
                for least in range(rows.start, rows.stop):  # the tendon that is at the floor
                    share = float(self.slack_free[tendon] / self.slack_free[least])
                    row = self.demand[tendon] - share * self.demand[least]
                    out.append((tendon, row if tendon != least else 0.0 * row, share * self.floor_n))
        return out
