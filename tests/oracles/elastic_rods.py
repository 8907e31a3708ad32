"""Shapes of elastic rods computed by SoRoSim beside those of `ElasticRod`.

The tables are of the public repository `ContinuumRoboticsLab/opencr-mujoco` (MIT, commit 17fff8b). Their
conventions were found by symmetry and by solving: the rod is clamped at the origin and straight along x;
every row is in the base frame; loads are dead (moments and forces keep their direction); `gravity` is the
acceleration; the rotation is Rx(EulX) Ry(EulY) Rz(EulZ). The shapes of TPU were computed without torsion
(their frames agree to 0.1 deg with a torsional stiffness 1000 times as large); points and tangents do not
depend on it. The rounding of the printed loads moves shapes by up to 0.08 % of the length. contid's rod
grows along z: its axes (x, y, z) are the (y, z, x) of the data.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contid import ElasticRod, Wrench
from contid.kinematics.array import Array

#: E [Pa], Poisson's ratio, density [kg/m^3], radius [m], length [m].
RODS = {"spring_steel": (200e9, 0.33, 7870.0, 0.8e-3, 0.6), "tpu": (70e6, 0.4, 1200.0, 5e-3, 0.4)}
#: Largest distance of a point, as a part of the length; the loads are printed with four decimals.
ALLOWED = 1e-3
TO_MODEL = [1, 2, 0]


@dataclass(frozen=True)
class Compared:
    """One shape: distance as a part of the length, angle of tangents [rad], fastest of three calls [us]."""

    distance: float
    angle: float
    microseconds: float


def rod(name: str) -> ElasticRod:
    """The rod of a table, in SI."""
    modulus, poisson, density, radius, length = RODS[name]
    return ElasticRod(length, radius, modulus_pa=modulus, poisson=poisson, density_kg_m3=density, si=True)


def shapes(table: Path) -> tuple[Array, Array]:
    """Stations (14,) as parts of the length, and shapes (n, 6, 17): gravity, two wrenches, the stations."""
    _, head, *rows = table.read_text(encoding="utf-8").splitlines()
    halves = np.array([float(cell) for cell in head.split(",")[4:]]).reshape(2, 7)
    values = np.array([[float(cell) for cell in row.split(",")[1:]] for row in rows]).reshape(-1, 6, 17)
    return 0.5 * np.concatenate([halves[0], 1.0 + halves[1]]), values


def compared(steel_or_tpu: ElasticRod, at: Array, shape: Array) -> Compared:
    """A shape of the table and the same loads on the rod."""
    moments, forces = shape[:3][TO_MODEL], shape[3:][TO_MODEL]
    length = steel_or_tpu.length
    loads = [
        Wrench(0.5 * length, forces[:, 1], moments[:, 1]),
        Wrench(length, forces[:, 2], moments[:, 2]),
    ]
    spent = np.inf
    for _ in range(3):
        begin = time.perf_counter_ns()
        found = steel_or_tpu.statics(at * length, loads=loads, gravity=forces[:, 0])
        spent = min(spent, (time.perf_counter_ns() - begin) / 1e3)
    assert found.carried == 1.0
    distance = np.max(np.linalg.norm(found.points - forces[:, 3:].T, axis=1)) / length
    # Along x the tangent of Rx(a) Ry(b) Rz(c) is its first column.
    a, b, c = shape[:3, 3:]
    tangent = np.stack(
        [
            np.cos(b) * np.cos(c),
            np.cos(a) * np.sin(c) + np.sin(a) * np.sin(b) * np.cos(c),
            np.sin(a) * np.sin(c) - np.cos(a) * np.sin(b) * np.cos(c),
        ],
        axis=1,
    )
    turned = np.linalg.norm(found.rotations[:, :, 2] - tangent[:, TO_MODEL], axis=1).max()
    return Compared(float(distance), float(2.0 * np.arcsin(0.5 * turned)), spent)


def compare_all(folder: Path) -> bool:
    """Print one line for each table; False where a point is farther off than allowed."""
    held = True
    for name in RODS:
        one = rod(name)
        at, table = shapes(folder / f"{name}.csv")
        found = [compared(one, at, shape) for shape in table]
        off, spent = [c.distance for c in found], [c.microseconds for c in found]
        far = sum(distance > ALLOWED for distance in off)
        held &= far == 0
        print(
            f"{name:12} {len(found)} shapes, {far} with a point more than {ALLOWED:.1%} of the length off: "
            f"worst {max(off):.4%}, median {np.median(off):.4%}, tangents within "
            f"{np.degrees(max(c.angle for c in found)):.2f} deg; {np.median(spent):.1f} us median, "
            f"{np.percentile(spent, 99):.1f} us at 99 %"
        )
    return held
