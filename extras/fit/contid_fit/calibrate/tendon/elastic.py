"""Bends of an elastic tendon robot along a recording: the least energy with dry friction, row by row.

Backbone: each section a spring with the stiffness K_k about its rest bend. Tendons: springs of one stiffness
that pull and never push, a little stiffer the more they are stretched (h). Pulls reach them through play of
half width r. With the energy divided by the stiffness of a tendon (no force is measured), each row is the
minimum over the bends Theta of

    1/2 sum_k K_k |Theta_k - rest_k|^2 + sum_i (e_i^2 / 2 + h e_i^3 / 3) + sum_k F_k |Theta_k - before_k|,
    before: Theta of the row before,   e = max(0, play(pull) + offset - G Theta)  (elongation of the tendons)

K in m^2 per rad^2, F (moment of friction in a bend) in m^2. The sum of a strictly convex energy and of the
dissipation has one minimum; taken row after row it is the quasi-static motion with dry friction, which
depends on the order of the rows but not on their times (Mielke, Roubicek: Rate-Independent Systems, 2015,
1.2). The bends after a release are therefore not the rest bends, and a recording continues from the end of
the one before.

Derivatives by all parameters are carried along, exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection
from contid_fit.calibrate.tendon.play_series import play_series

#: The dissipation is ``sqrt(|x|^2 + SMOOTH^2)``, so that it has derivatives [rad].
SMOOTH_RAD: Final = 2e-3
_STEP_RAD: Final = 1e-8
_ITERATIONS: Final = 60


@dataclass(frozen=True, eq=False)
class Elastic:
    """What the energy consists of; tendons from section 1 on.

    Attributes:
        count: number of tendons of each section.
        radius_m, angle_rad: distance from the backbone and azimuth of each tendon, at the end of its section.
        twist_rad: turn of the tendons of section j in each section k < j; (2, 1), (3, 1), (3, 2) and so on.
        hardening_per_m: h; the tension over stiffness is ``e + h e^2``.
        offset_m: offset of each tendon, positive where it is tight at pull 0.
        stiffness_m2: K of each section.
        rest_rad: rest bends, ``(2 sections,)``.
        friction_m2: F of each section.
        play_m: half width for the tendons of each section.
        through: tendons run through the sections before their own; else sheaths carry them, without twists.
    """

    count: tuple[int, ...]
    radius_m: Array
    angle_rad: Array
    twist_rad: Array
    hardening_per_m: float
    offset_m: Array
    stiffness_m2: Array
    rest_rad: Array
    friction_m2: Array
    play_m: Array
    through: bool = True

    @property
    def section(self) -> Array:
        """Number of the section of each tendon."""
        return np.repeat(np.arange(len(self.count)), self.count)

    @property
    def pull_matrix(self) -> Array:
        """G, twists included: pulls [m] by bends [rad]."""
        matrix = pull_matrix(self.count, self.radius_m, self.angle_rad, self.through)
        for where, twist in zip(self.twisted, self.twist_rad, strict=True):
            matrix = np.where(where, math.cos(twist) * matrix + math.sin(twist) * _quarter(matrix), matrix)
        return matrix

    @property
    def twisted(self) -> list[NDArray[np.bool_]]:
        """Elements of G that each twist turns."""
        sections = len(self.count)
        return [
            np.repeat((self.section == j)[:, None] & (np.arange(sections) == k), 2, axis=1)
            for j in range(sections if self.through else 0)
            for k in range(j)
        ]


def pull_matrix(count: Sequence[int], radius_m: Array, angle_rad: Array, through: bool = True) -> Array:
    """G of tendons without twist, as the model of a robot has it: pulls [m] by bends [rad]."""
    ends = np.cumsum((0, *count))
    return TendonGeometry(
        tuple(
            TendonSection(1.0, tuple(radius_m[low:high]), tuple(angle_rad[low:high]))
            for low, high in pairwise(ends)
        ),
        through,
    ).pull_matrix


class BendRows(NamedTuple):
    """Bends of every row.

    Attributes:
        bends: ``(rows, 2 sections)`` [rad].
        elongation_m: elongation of the tendons, ``(rows, tendons)``; below 0 they are slack.
        by: derivatives of the bends by the parameters of each kind, ``(rows, 2 sections, parameters)``:
            ``radius_m``, ``angle_rad`` and ``offset_m`` of every tendon, ``rest_rad``, ``twist_rad``, and the
            logarithms ``log_stiffness``, ``log_friction``, ``log_play`` and ``log_hardening``.
    """

    bends: Array
    elongation_m: Array
    by: dict[str, Array]


def series(elastic: Elastic, pull_m: Array) -> BendRows:
    """Bends of pulls ``(rows, tendons)`` [m]; the robot starts at its rest bends."""
    solver = _Rows(elastic)
    arrived, by_width = play_rows(pull_m, solver.r)
    rows, n = len(pull_m), len(elastic.rest_rad)
    bends, by = np.empty((rows, n)), np.empty((rows, n, solver.columns))
    elongation = np.empty_like(pull_m)
    before, before_by = elastic.rest_rad, np.zeros((n, solver.columns))
    before_by[:, solver.place["rest_rad"]] = np.eye(n)
    for row, tight in enumerate(arrived + elastic.offset_m):
        bends[row] = solver.minimum(before, tight)
        elongation[row] = tight - solver.G @ bends[row]
        by[row] = solver.derivative(before, before_by, bends[row], elongation[row], by_width[row])
        before, before_by = bends[row], by[row]
    return BendRows(bends, elongation, {name: by[:, :, place] for name, place in solver.place.items()})


def play_rows(pull: Array, width: Array) -> tuple[Array, Array]:
    """Pulls ``(rows, tendons)`` after play of a half width, and their derivatives by it."""
    arrived, slopes = play_series(pull, width), np.empty_like(pull)
    slope = np.zeros(pull.shape[1])
    for row, moved in enumerate(np.sign(np.diff(arrived, axis=0, prepend=pull[:1]))):
        slope = np.where(moved == 0.0, slope, -moved)
        slopes[row] = slope
    return arrived, slopes


def _quarter(arms: Array) -> Array:
    """Every arm in the rows of G turned by 90 degrees."""
    turned = np.empty_like(arms)
    turned[:, 0::2], turned[:, 1::2] = -arms[:, 1::2], arms[:, 0::2]
    return turned


class _Rows:
    """The minimum of one row after the other; h, G, K and r as in the module, per tendon or bend."""

    def __init__(self, elastic: Elastic) -> None:
        self.elastic = elastic
        sections, tendons = len(elastic.count), len(elastic.radius_m)
        self.h = elastic.hardening_per_m
        self.G, self.twisted = elastic.pull_matrix, elastic.twisted
        self.K = np.repeat(elastic.stiffness_m2, 2)
        self.r = elastic.play_m[elastic.section]
        self.by_radius = self.G / elastic.radius_m[:, None]
        self.by_angle = _quarter(self.G)
        self.own = elastic.section[:, None] == np.arange(sections)
        self.pairs = np.repeat(np.eye(sections), 2, axis=0)
        self.blocks = self.pairs @ self.pairs.T
        sizes = {
            **dict.fromkeys(("radius_m", "angle_rad", "offset_m"), tendons),
            **dict.fromkeys(("log_stiffness", "log_friction", "log_play"), sections),
            "rest_rad": 2 * sections,
            "twist_rad": len(self.twisted),
            "log_hardening": 1,
        }
        ends = np.cumsum([0, *sizes.values()]).tolist()
        #: Columns of the derivatives by the parameters of each kind.
        self.place = dict(zip(sizes, map(slice, ends[:-1], ends[1:]), strict=True))
        self.columns: int = ends[-1]

    def _energy(self, bends: Array, last: Array, tight: Array) -> float:
        off = bends - self.elastic.rest_rad
        e = np.maximum(tight - self.G @ bends, 0.0)
        change = ((bends - last) ** 2) @ self.pairs
        slid = np.sqrt(change + SMOOTH_RAD**2) @ self.elastic.friction_m2
        return float(0.5 * (self.K * off) @ off + 0.5 * e @ e + self.h / 3.0 * (e * e) @ e + slid)

    def _friction(self, bends: Array, last: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the dissipation."""
        change = bends - last
        size = np.sqrt((change**2) @ self.pairs + SMOOTH_RAD**2)
        force = self.pairs @ (self.elastic.friction_m2 / size)
        unit = change / (self.pairs @ size)
        hessian = -(force[:, None] * self.blocks * (unit[:, None] * unit))
        hessian.flat[:: len(bends) + 1] += force
        return force * change, hessian

    def minimum(self, last: Array, tight: Array) -> Array:
        """Newton's method with halved steps; the energy is convex and its gradient piecewise smooth."""
        bends = last
        energy = self._energy(bends, last, tight)
        for _ in range(_ITERATIONS):
            e = np.maximum(tight - self.G @ bends, 0.0)
            pulling = self.G.T * ((e > 0.0) * (1.0 + 2.0 * self.h * e))
            slope, curve = self._friction(bends, last)
            gradient = self.K * (bends - self.elastic.rest_rad) - (e + self.h * e * e) @ self.G + slope
            hessian = pulling @ self.G + curve
            hessian.flat[:: len(bends) + 1] += self.K
            step = np.linalg.solve(hessian, gradient)
            part = 1.0
            while True:
                trial = bends - part * step
                found = self._energy(trial, last, tight)
                if found <= energy or part < 1e-4:
                    break
                part *= 0.5
            bends, energy = trial, found
            if part * float(np.abs(step).max()) < _STEP_RAD:
                break
        return bends

    def derivative(
        self, before: Array, before_by: Array, bends: Array, elongation: Array, by_width: Array
    ) -> Array:
        """Of the minimum, by all parameters: the gradient of the energy stays zero.

        Args:
            before: bends of the row before.
            before_by: their derivatives.
            bends: the minimum.
            elongation: elongation of the tendons there.
            by_width: derivatives of the arrived pulls by the play of their tendon.
        """
        held = np.maximum(elongation, 0.0)
        on: Array = np.where(elongation > 0.0, 1.0 + 2.0 * self.h * held, 0.0)
        pull, active = held + self.h * held**2, self.G.T * on
        slope, curve = self._friction(bends, before)
        change, place = np.empty((len(bends), self.columns)), self.place
        for name, by in (("radius_m", self.by_radius), ("angle_rad", self.by_angle)):
            change[:, place[name]] = -by.T * pull + active * (by @ bends)
        change[:, place["offset_m"]] = -active
        change[:, place["log_stiffness"]] = self.pairs * (self.K * (bends - self.elastic.rest_rad))[:, None]
        change[:, place["rest_rad"]] = -np.diag(self.K)
        change[:, place["log_friction"]] = self.pairs * slope[:, None]
        change[:, place["log_play"]] = -(active * (by_width * self.r)) @ self.own
        for column, which in enumerate(self.twisted, place["twist_rad"].start):
            rotated: Array = np.where(which, self.by_angle, 0.0)
            change[:, column] = -rotated.T @ pull + active @ (rotated @ bends)
        change[:, place["log_hardening"]] = (-self.h * (held**2) @ self.G)[:, None]
        hessian = active @ self.G + curve
        hessian.flat[:: len(bends) + 1] += self.K
        return np.asarray(np.linalg.solve(hessian, curve @ before_by - change), dtype=np.float64)
