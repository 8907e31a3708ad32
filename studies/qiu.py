"""Full poses of three sections by the method of Qiu et al. (Robotics: Science and Systems 2023).

"An Efficient Multi-solution Solver for the Inverse Kinematics of 3-Section Constant-Curvature Robots".

A section of length L that bends by theta towards phi has the chord ``rho(z) r`` with the unit vector
``r = (sin(theta/2) cos phi, sin(theta/2) sin phi, cos(theta/2))``, ``rho(z) = L sqrt(1 - z^2) / acos z``, and
the turn of the quaternion ``(z; -y, x, 0)``. For an end frame with the quaternion ``(a; b, c, d)`` at p:

* the last section lies near a circle on the unit sphere, about ``n = B^T p``: one unknown remains;
* for each point of the circle the first section is where two planes meet the sphere, the middle one follows
  from the rotation, or from the translation; the better of both is kept;
* minima of the error along the circle are corrected by Newton's method, over finer circles where none
  converges, and at last by damped steps.

Here all points of a circle are one array. Limits are not part of the method. Errors are measured as the
kernels do: metres, and a rotation vector times a fifth of the length; Newton may take more steps than the
published four to six, because the tolerance here is finer. ``python -m studies.qiu [POSES]`` compares it with
contid's compiled solver, in one process.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Final

import click
import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import BendSections
from studies.arc_chains import Goal, task

#: Parts of the circle, and corrections of the last and of the first section, from coarse to fine.
CIRCLES: Final = ((0.03, 1, 2), (0.01, 5, 2), (0.001, 5, 5))
#: Place of the approximated circle between a straight and a half-turned section.
GAMMA: Final = 0.5 + 1.0 / math.pi
NEWTON_STEPS: Final = 12
DAMPED_STEPS: Final = 200


class QiuSolver:
    """Bends of three sections of one length for the frame at their end.

    Args:
        length_m: of each section.
        ell_m: length that a radian of the error counts as [m].
        tolerance_m: error at which a pose is met [m].
    """

    def __init__(self, length_m: float, ell_m: float, tolerance_m: float = 1e-6) -> None:
        self.length_m, self.ell_m, self.tolerance_m = length_m, ell_m, tolerance_m
        self.sections = BendSections((length_m,) * 3, (0.0,) * 3)

    def solve(self, tip_m: Array, rotation: Array) -> tuple[Array, float]:
        """Variables ``L Theta`` (6,) [m] of the first solution found, and the error left [m]."""
        goal = Goal(tuple(tip_m.tolist()), rotation=tuple(rotation.ravel().tolist()))
        best, least, starts = np.zeros(6), math.inf, []
        for part, last, first in CIRCLES:
            starts = list(self._starts(tip_m / self.length_m, rotation, part, last, first))
            for start in starts:
                found, error = self._corrected(start, goal, NEWTON_STEPS, damped=False)
                if error < least:
                    best, least = found, error
                if error <= self.tolerance_m:
                    return found, error
        for start in starts:
            found, error = self._corrected(start, goal, DAMPED_STEPS, damped=True)
            if error < least:
                best, least = found, error
            if error <= self.tolerance_m:
                break
        return best, least

    def _corrected(self, x: Array, goal: Goal, steps: int, damped: bool) -> tuple[Array, float]:
        e, J = task(self.sections, self.ell_m, x, goal)
        for _ in range(steps):
            if float(np.linalg.norm(e)) <= self.tolerance_m:
                break
            square = J.T @ J
            if damped:
                square = square + float(np.max(np.diag(square))) * np.eye(6)
            try:
                x = self._wrapped(x + np.linalg.solve(square, J.T @ e))
            except np.linalg.LinAlgError:
                break
            e, J = task(self.sections, self.ell_m, x, goal)
        return x, float(np.linalg.norm(e))

    def _wrapped(self, x: Array) -> Array:
        """Bends within one turn: more of them lead to another chord, but no section bends so far."""
        bends = x.reshape(3, 2) / self.length_m
        size = np.maximum(np.linalg.norm(bends, axis=1), 1e-300)
        folded: Array = (bends * (np.mod(size, math.tau) / size)[:, None] * self.length_m).ravel()
        return folded

    def _starts(self, p: Array, rotation: Array, part: float, last: int, first: int) -> Iterator[Array]:
        """Minima of the error along the circle, those opposite of its begin first; lengths are 1."""
        b, c, d, a = Rotation.from_matrix(rotation).as_quat().tolist()
        B = np.array([[d, a, b], [-a, d, c], [-b, -c, d]])
        q = np.array([a, b, c, d])
        # The begin is not repeated at the end.
        t = np.arange(0.0, 1.0 - 1e-9, part)
        n0 = B.T @ p
        size = float(np.linalg.norm(n0))
        if size < 1e-12:
            return
        n = n0 / size
        middle = GAMMA * d / size * n
        across = math.sqrt(max(1.0 - float(middle @ middle), 0.0))
        u = np.array([n[1], -n[0], 0.0])
        u = u / np.linalg.norm(u) if np.linalg.norm(u) > 1e-12 else np.array([1.0, 0.0, 0.0])
        v = np.cross(n, u)
        r3 = middle + across * (np.outer(np.sin(math.tau * t), u) + np.outer(np.cos(math.tau * t), v))
        for _ in range(last if d else 0):
            slope = (n0 + _z(d * _bent(r3[:, 2]))) @ middle
            r3 = _unit(r3 - ((r3 @ n0 - d * _rho(r3[:, 2])) / slope)[:, None] * middle)
        r1 = self._first(n0, d, r3 @ B.T, first)
        r2, error = self._middle(q, B, p, r1, r3)
        before, after = np.roll(error, 1), np.roll(error, -1)
        minima = np.flatnonzero((error <= before) & (error < after) & np.isfinite(error))
        for k in minima[np.argsort(np.abs(t[minima] - 0.5), kind="stable")]:
            yield self.length_m * np.concatenate([_bends(r[k]) for r in (r1, r2, r3)])

    @staticmethod
    def _first(n0: Array, d: float, ne: Array, corrections: int) -> Array:
        """Unit vectors with ``n0 . r = d rho(r_z)`` and ``ne . r = 0``, two planes and the sphere."""
        # Along the line of both planes: a point of least size, and its direction.
        along = np.cross(n0, ne)
        square = np.maximum(np.einsum("ki,ki->k", along, along), 1e-300)
        point = GAMMA * d * np.cross(ne, along) / square[:, None]
        left = 1.0 - np.einsum("ki,ki->k", point, point)
        step = np.sqrt(np.maximum(left, 0.0) / square)
        step = np.where(along[:, 2] >= 0.0, step, -step)  # the one that bends less
        r = _unit(point + step[:, None] * along)
        for _ in range(corrections if d else 0):
            rows = np.stack((n0 + _z(d * _bent(r[:, 2])), ne), axis=1)
            columns = np.stack((np.broadcast_to(n0, ne.shape), ne), axis=2)
            wrong = np.stack((r @ n0 - d * _rho(r[:, 2]), np.einsum("ki,ki->k", ne, r)), axis=1)
            gram = rows @ columns + 1e-15 * np.eye(2)
            r = _unit(r - np.einsum("kij,kj->ki", columns, np.linalg.solve(gram, wrong[:, :, None])[:, :, 0]))
        return r

    @staticmethod
    def _middle(q: Array, B: Array, p: Array, r1: Array, r3: Array) -> tuple[Array, Array]:
        """The middle section from rotation or translation, the one that leaves less, and what it leaves."""
        target = Rotation.from_quat([q[1], q[2], q[3], q[0]])
        turn1, turn3 = _turn(r1), _turn(r3)
        between = turn1.inv() * target * turn3.inv()
        quat = between.as_quat()
        by_turn = _unit(np.stack((quat[:, 1], -quat[:, 0], quat[:, 3]), axis=1))
        by_turn = np.where(by_turn[:, 2:] < 0.0, -by_turn, by_turn)
        end3 = (target * turn3.inv()).apply(_rho(r3[:, 2])[:, None] * r3)
        by_chord = _unit(turn1.inv().apply(p - end3 - _rho(r1[:, 2])[:, None] * r1))
        errors = []
        for r2 in (by_turn, by_chord):
            tip = _rho(r1[:, 2])[:, None] * r1 + turn1.apply(_rho(r2[:, 2])[:, None] * r2) + end3
            off = (turn1 * _turn(r2) * turn3).inv() * target
            errors.append(np.hypot(np.linalg.norm(tip - p, axis=1), off.magnitude()))
        better = errors[0] < errors[1]
        return np.where(better[:, None], by_turn, by_chord), np.where(better, *errors)


def _rho(z: Array) -> Array:
    """Chord of an arc of length 1 whose half bend has the cosine z."""
    half = np.arccos(np.clip(z, -1.0, 1.0))
    return np.asarray(np.where(half > 1e-9, np.sin(half) / np.maximum(half, 1e-300), 1.0))


def _bent(z: Array) -> Array:
    """Minus the derivative of the chord by z, as the correction of the paper has it."""
    half = np.maximum(np.arccos(np.clip(z, -1.0, 1.0)), 1e-6)
    return np.asarray(1.0 / half - 1.0 / np.maximum(np.sin(half), 1e-6))


def _z(values: Array) -> Array:
    out = np.zeros((len(values), 3))
    out[:, 2] = values
    return out


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300))


def _turn(r: Array) -> Rotation:
    """Turns of sections: the quaternion (z; -y, x, 0)."""
    return Rotation.from_quat(np.stack((-r[:, 1], r[:, 0], np.zeros(len(r)), r[:, 2]), axis=1))


def _bends(r: Array) -> Array:
    """Bend of one section (2,) [rad]."""
    theta, phi = 2.0 * math.acos(min(1.0, max(-1.0, float(r[2])))), math.atan2(r[1], r[0])
    return theta * np.array([math.cos(phi), math.sin(phi)])


@click.command()
@click.argument("count", metavar="[POSES]", default=200, type=click.IntRange(1))
def main(count: int) -> None:
    """Compare both methods on POSES random reachable poses of `tendon3`."""
    from contid.kinematics.model import build_model
    from contid.kinematics.tendon.feasible import ell_of
    from contid.kinematics.tendon.model import TendonModel
    from contid.robot_file.load import load_named
    from contid.robot_file.tendon.robot import TendonRobot
    from contid.targets import Target

    (robot,) = load_named("tendon3").file.robots.values()
    assert isinstance(robot, TendonRobot)
    model = build_model(robot)
    assert isinstance(model, TendonModel)
    feasible, rng = model.feasible, np.random.default_rng(23)
    length = feasible.sections.backbone_m[0]
    lengths = np.repeat(feasible.sections.backbone_m, 2)
    qiu = QiuSolver(length, ell_of(feasible))
    ours, theirs = "contid", "Qiu et al., NumPy"
    rows: dict[str, list[tuple[bool, bool, float]]] = {theirs: [], ours: []}
    for _ in range(count):
        bends = feasible.pulled(rng.uniform(feasible.low, feasible.high)) / lengths
        pulls = tuple((np.zeros(9) if model.statics is None else model.statics.pulls(bends)).tolist())
        pose = model.forward(pulls)
        frame = np.reshape(pose.rotation, (3, 3))
        end = np.array(pose.tip_m) - (0.0, 0.0, robot.geometry.base_offset_mm / 1e3)
        end = end - frame @ np.array(robot.tip_offset_m)
        start = time.perf_counter()
        found, error = qiu.solve(end, frame)
        took = time.perf_counter() - start
        inside = bool(np.max(feasible.excess(found)) <= 1e-9)
        rows[theirs].append((error <= 1e-6, inside and error <= 1e-6, took))
        target = Target(tip_m=pose.tip_m, rotation=pose.rotation)
        start = time.perf_counter()
        answer = model.inverse(target, robot.rest)
        rows[ours].append((answer.converged, answer.converged, time.perf_counter() - start))
    for name, results in rows.items():
        met, kept, seconds = (np.array(each) for each in zip(*results, strict=True))
        median, p99 = np.percentile(1e3 * seconds, [50, 99])
        click.echo(
            f"{name}: {100 * met.mean():.1f} % of {count} met at 1e-6 m, {100 * kept.mean():.1f} % "
            f"inside every limit; median {median:.3g} ms, p99 {p99:.3g} ms"
        )


if __name__ == "__main__":
    main()
