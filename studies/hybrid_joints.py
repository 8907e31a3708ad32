"""How much the hybrid method of Singh et al. (2017) depends on what its text leaves open: joints per section.

Lakhal et al. model a section as a chain of 3UPS-1UP joints. The text gives neither the radii and heights of
the plates, nor the rule that divides a tube between joints, nor where a universal joint is (below or above
its prismatic piece), nor the network's inputs: the method cannot be reproduced. Here is the least that is
defined: n equal joints per section, each of which turns by the same angle and then extends along its new
axis by the chord of its piece of the arc. Lengths are solved on that chain and scored on the arcs:

    python -m studies.hybrid_joints

The figures are the cost of the placing of the joints, not what the method reaches: no network is in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import click
import numpy as np

from contid.kinematics.arc.sections import Sections
from contid.kinematics.array import Array
from studies.arc_chains import differentiate, forward
from studies.singh import cbha_sections, damped, golden_trajectory

#: Joints per section of the printed lines: between 17 vertebrae of both sections, and twice as many.
JOINTS: Final = (8, 16)


def joint_chain(arcs: Array, joints: int) -> Array:
    """Tip (3,) [m] of sections ``(n, 3)`` of (u, v, L), each a chain of joints that turn, then extend."""
    position, frame = np.zeros(3), np.eye(3)
    for u, v, length in arcs.tolist():
        theta = math.hypot(u, v)
        each = theta / joints
        piece = length / joints
        chord = piece * (math.sin(0.5 * each) / (0.5 * each) if each > 0.0 else 1.0)
        turn = _turn(u / joints, v / joints)
        for _ in range(joints):
            frame = frame @ turn
            position = position + chord * frame[:, 2]
    return position


def inverse(sections: Sections, target_m: Array, lengths: Array, joints: int) -> Array:
    """Tube lengths (6,) [m] of the chain of joints at a target; steps with the Jacobian of arcs."""
    for _ in range(60):
        error = target_m - joint_chain(sections.arcs(lengths), joints)
        if float(np.linalg.norm(error)) < 1e-9:
            return lengths
        lengths = lengths + damped(differentiate(sections, lengths).tip, error)
    raise ArithmeticError(f"no lengths found for {target_m} in 60 steps")


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Tip errors of the arcs with lengths of the chain, over the golden trajectory [mm]."""

    joints: int
    max_mm: tuple[float, float, float]
    mean_mm: float


def sensitivity(joints: int) -> Sensitivity:
    """The error that the joints' placing makes, each point solved from the one before."""
    sections, path = cbha_sections(), golden_trajectory()
    lengths, found = path.lengths_m[0], []
    for tip in path.tips_m:
        lengths = inverse(sections, tip, lengths, joints)
        found.append(lengths)
    error = 1e3 * (forward(sections, np.array(found)).tip - path.tips_m)
    x, y, z = np.abs(error).max(axis=0).tolist()
    return Sensitivity(joints, (x, y, z), float(np.linalg.norm(error, axis=1).mean()))


def _turn(u: float, v: float) -> Array:
    """Rotation by the bend vector (u, v) [rad]: exp of (-v, u, 0)."""
    theta = math.hypot(u, v)
    if theta == 0.0:
        return np.eye(3)
    x, y = -v / theta, u / theta
    cross = np.array(((0.0, 0.0, y), (0.0, 0.0, -x), (-y, x, 0.0)))
    return np.asarray(np.eye(3) + math.sin(theta) * cross + (1.0 - math.cos(theta)) * cross @ cross)


@click.command()
def main() -> None:
    """Print one line per number of joints."""
    for joints in JOINTS:
        row = sensitivity(joints)
        x, y, z = row.max_mm
        click.echo(
            f"sensitivity, not the method: {joints} joints per section instead of arcs: tip error up to "
            f"{x:.2f}, {y:.2f}, {z:.2f} mm (x, y, z), mean {row.mean_mm:.2f} mm"
        )


if __name__ == "__main__":
    main()
