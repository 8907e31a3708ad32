"""The model of tendon robots whose motors wind several tendons at once: travels of drives to a tip, and back.

Pulls are ``q = D m`` with the travels m of the drives. Bends follow from the balance of tendons and backbone,

    Theta = A m,    A = (G^T k G + K)^-1 G^T k D,    or without stiffness  A = G^+ D  with  D m = G Theta,

and the tensions are ``tau = tau0 + k (D - G A) m``: linear, so that travel, slack and largest tension are
planes in the bends, and the solver of the tendon robots keeps them. Drives cannot tighten a section: tau0 is
the pretension. Fewer drives than bends hold the bends in a subspace: two planes with nothing between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from contid.kinematics.arc.solver import nearest_note
from contid.kinematics.array import Array
from contid.kinematics.tendon.described import bend_max_of, bends_by_pulls, geometry_of, statics_of
from contid.kinematics.tendon.feasible import PullPlane, TendonFeasible, build_bend_solver
from contid.kinematics.tendon.model import TendonModel
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import ZERO3, Actuation, Solution, Target, Vec3

#: Name of the limit of bends that the drives of a robot do not reach.
DRIVES: Final = "drives"
#: Half the distance of the two planes that hold bends in the subspace of the drives [m].
_HELD_M: Final = 1e-7
#: Part of a bend outside the reach of the drives that is rounding of azimuths [rad].
_ROUNDED_RAD: Final = 1e-4


class SharedPlanes:
    """Limits that the drives of a robot share: planes of tension and pull, then the bend of every section.

    Each is scaled so that no drive changes it by more than it moves (`contid.control.tick.shared_limits`).

    Args:
        feasible: limits of the bends; the first ``skipped`` planes are those of single drives.
        by_drives: variables of the solver by travels, shape ``(2 sections, drives)``.
        skipped: number of planes that are left out.
    """

    def __init__(self, feasible: TendonFeasible, by_drives: Array, skipped: int) -> None:
        kept = [k for k in range(skipped, feasible.flat) if feasible.plane_names[k] != DRIVES]
        rows = feasible.normals[kept] @ by_drives
        scale = 1.0 / np.maximum(np.abs(rows).max(axis=1, initial=0.0), 1e-9)
        self._rows = scale[:, None] * rows
        self._offsets = scale * feasible.offsets[kept]
        self._bends = by_drives.reshape(-1, 2, by_drives.shape[1])
        steepest = np.linalg.norm(self._bends, axis=1).max(axis=1)
        self._cone_scale = 1.0 / np.maximum(steepest, 1e-9)
        self._cone_bound = np.array(feasible.sections.backbone_m) * np.array(feasible.bend_max_rad)

    def excess(self, actuation: Actuation, /) -> list[float]:
        """By how much every limit is exceeded [m], negative inside; convex."""
        travel = np.array(actuation)
        cones = np.sqrt(((self._bends @ travel) ** 2).sum(axis=1)) - self._cone_bound
        found: list[float] = (self._rows @ travel - self._offsets).tolist()
        return found + [float(each) for each in self._cone_scale * cones]

    def gradient(self, actuation: Actuation, number: int, /) -> list[float]:
        """Derivative of one excess by the travels."""
        planes = len(self._offsets)
        if number < planes:
            row: list[float] = self._rows[number].tolist()
            return row
        section = number - planes
        bend = self._bends[section] @ np.array(actuation)
        along = bend / (float(np.hypot(*bend)) or 1.0)
        slope: list[float] = (self._cone_scale[section] * along @ self._bends[section]).tolist()
        return slope


@dataclass(frozen=True, eq=False)
class DriveMap:
    """How drives, tendons and bends depend on each other.

    Attributes:
        pulls_by_drives: D, shape ``(tendons, drives)``.
        bends_by_drives: A [rad/m], shape ``(2 sections, drives)``.
        drives_by_bends: its pseudo-inverse [m/rad].
        outside: unit vectors across the bends that drives reach, shape ``(directions, 2 sections)``.
    """

    pulls_by_drives: Array
    bends_by_drives: Array
    drives_by_bends: Array
    outside: Array

    @classmethod
    def of(cls, bends_by_pulls: Array, pulls_by_drives: Array) -> DriveMap:
        """From the bends that pulls give [rad/m] and from the drives."""
        by_drives = bends_by_pulls @ pulls_by_drives
        basis, _, _ = np.linalg.svd(by_drives)
        by_bends = np.asarray(np.linalg.pinv(by_drives), dtype=np.float64)
        return cls(pulls_by_drives, by_drives, by_bends, basis[:, by_drives.shape[1] :].T)


class DrivenTendonModel(TendonModel):
    """Forward and inverse kinematics of a tendon robot with ``drives``; its actuation is their travel [m].

    Everything of `TendonModel` that depends on bends alone is inherited.
    """

    #: The limits of tension are shared by the drives and convex: a straight line between two actuations
    #: inside them stays inside.
    straight_approach = True

    def __init__(self, robot: TendonRobot) -> None:  # not that of the base class: other limits, another map
        matrix = robot.drive_matrix
        assert matrix is not None
        self.axis_names, self.lower, self.upper = robot.axis_names, robot.lower, robot.upper
        self.geometry = geometry_of(robot)
        self.statics = statics_of(robot, self.geometry)
        self.drives = DriveMap.of(bends_by_pulls(self.geometry, self.statics), matrix)
        planes = [*self._travel_planes(), *self._pull_planes(robot), *self._subspace_planes()]
        self.feasible = TendonFeasible.of(self.geometry, bend_max_of(robot), planes)
        self._lengths = np.repeat(self.feasible.sections.backbone_m, 2)
        self.solver = build_bend_solver(self.feasible)
        self._base_m = self.geometry.base_offset_m
        self._by_pulls = self._lengths[:, None] * self.drives.bends_by_drives
        self.shared = SharedPlanes(self.feasible, self._by_pulls, 2 * len(self.axis_names))
        self.taut = self.capstan = self._correction = None

    def _travel_planes(self) -> list[PullPlane]:
        """Least and largest travel of every drive."""
        found = []
        for name, row, low, high in zip(
            self.axis_names, self.drives.drives_by_bends, self.lower, self.upper, strict=True
        ):
            found += [PullPlane(f"{name}.min", -row, -low), PullPlane(f"{name}.max", row, high)]
        return found

    def _pull_planes(self, robot: TendonRobot) -> list[PullPlane]:
        """Slack, largest tension and, where they have limits, pulls of every tendon."""
        found = []
        pulls = self.drives.pulls_by_drives @ self.drives.drives_by_bends
        if self.statics is not None and robot.tension is not None:
            stretch = pulls - self.geometry.pull_matrix
            rest_n, k = self.statics.rest_n.tolist(), self.statics.tendon_n_per_m.tolist()
            for name, row, rest, stiff in zip(robot.tendon_names, stretch, rest_n, k, strict=True):
                found.append(PullPlane(f"{name}.slack", -row, (rest - robot.tension.floor_n) / stiff))
                found.append(PullPlane(f"{name}.tension", row, (robot.tension.max_n - rest) / stiff))
        for name, row, (low, high) in zip(robot.tendon_names, pulls, robot.pull_limits_m, strict=False):
            found += [PullPlane(f"{name}.min", -row, -low), PullPlane(f"{name}.max", row, high)]
        return found

    def _subspace_planes(self) -> list[PullPlane]:
        """Two planes for every direction of bends that the drives do not reach."""
        scale = np.repeat([section.length_m for section in self.geometry.sections], 2)
        rows = [row * float(np.abs(scale * row).max()) for row in self.drives.outside]
        return [PullPlane(DRIVES, sign * row, _HELD_M) for row in rows for sign in (1.0, -1.0)]

    @property
    def limit_names(self) -> tuple[str, ...]:
        """Names in the order of `excess`."""
        return self.feasible.names

    def excess(self, actuation: Actuation) -> Array:
        """By how much limits of travel, tension, pulls and bends are exceeded by travels [m], < 0 inside."""
        return self.feasible.excess(self._by_pulls @ np.asarray(actuation))

    def tendon_pulls(self, actuation: Actuation | Array) -> Array:
        """Pulls ``(tendons,)`` [m] of travels [m]."""
        pulls: Array = self.drives.pulls_by_drives @ np.asarray(actuation)
        return pulls

    def of_arcs(self, arcs: Sequence[float], seed: Actuation, load_n: Vec3 = ZERO3) -> Actuation:
        """Travels that have these bends (`contid.kinematics.model.Bending`); NaN where none have."""
        bends = np.reshape(arcs, (-1, 3))[:, :2].ravel()
        if np.any(np.abs(self.drives.outside @ bends) > _ROUNDED_RAD):
            return (np.nan,) * len(self.axis_names)
        return super().of_arcs(arcs, seed, load_n)

    def inverse(self, target: Target, seed: Actuation) -> Solution:
        """Travels inside every limit for a tip, as in `TendonModel.inverse`."""
        found = super().inverse(target, seed)
        if DRIVES not in found.limited_by:
            return found
        if found.converged:
            return replace(found, limited_by=tuple(name for name in found.limited_by if name != DRIVES))
        others = tuple(name for name in found.limited_by if name != DRIVES)
        if others:
            return replace(found, limited_by=others)
        return replace(found, note=f"{nearest_note(found.residual_m)}; the drives do not bend it that way")

    def _pulls_of(self, bends: Array) -> Array:
        travels: Array = self.drives.drives_by_bends @ bends
        return travels
