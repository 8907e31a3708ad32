"""Rods, and their tasks with errors by `forward` of the kernel, for its tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.array import Array
from contid.kinematics.cosserat.engine import InverseAnswer, RodSolver
from contid.kinematics.cosserat.section import Loads, Rod
from contid.targets import Vec3
from tests.kinematics.cosserat_cases import section

#: Own weight per length of sections, and of the first link [N/mm].
WEIGHT = np.array([1e-4, -2e-4, 1e-3])
#: Step of differences [bar].
STEP = 1e-5


def rod_of(sections: int, tip_link: float = 3.0) -> Rod:
    """Sections of both kinds in turn, each turned about its axis, 5 mm of link between them."""
    last = sections - 1
    return Rod(
        tuple(section(i % 2, 5.0 if i < last else tip_link, first_pair_rad=0.3 * i) for i in range(sections))
    )


def own_weight(sections: int) -> Loads:
    return Loads(weight=dict.fromkeys(range(sections), WEIGHT), link_weight={0: 2.0 * WEIGHT})


@dataclass(frozen=True)
class Task:
    """A target: tip and mid-point [mm], direction of the tip, and the force on the tip [N]."""

    tip: Vec3
    mid: Vec3 | None = None
    direction: Vec3 | None = None
    force: Vec3 = (0.0, 0.0, 0.0)

    @classmethod
    def reached(cls, engine: RodSolver, bar: Array, kind: str, force: Vec3) -> Task | None:
        """Where pressures [bar] bring the arm, for a kind of target; None where it is not stable."""
        at = engine.forward(bar.tolist(), force)
        if not at.stable:
            return None
        direction = (at.rotation[2], at.rotation[5], at.rotation[8])
        return cls(
            at.tip_mm, at.mid_mm if kind == "mid" else None, direction if kind == "direction" else None, force
        )

    def solve(self, engine: RodSolver, seed: Array) -> InverseAnswer:
        return engine.inverse(self.tip, self.mid, self.direction, self.force, seed.tolist())

    def error(self, engine: RodSolver, bar: Array) -> Array:
        """Rows of the error of pressures [mm], as the inverse defines it.

        A direction counts by its chord, a frame by twice the vector of the quaternion that turns it.
        """
        at, length = engine.forward(bar.tolist(), self.force), engine.setup.direction_length
        rows = [np.subtract(at.tip_mm, self.tip)]
        if self.mid is not None:
            rows.append(np.subtract(at.mid_mm, self.mid))
        if self.direction is not None:
            found = np.array(at.rotation).reshape(3, 3)
            if engine.setup.full_rotation:
                away = Rotation.from_matrix(found @ twist_free(np.array(self.direction)).T)
                rows.append(2.0 * length * away.as_quat(canonical=True)[:3])
            else:
                rows.append(length * (found[:, 2] - self.direction))
        return np.concatenate(rows)

    def jacobian(self, engine: RodSolver, bar: Array) -> Array:
        """Of the error by pressures [mm/bar], by central differences."""
        moves = STEP * np.eye(len(bar))
        return np.stack(
            [(self.error(engine, bar + d) - self.error(engine, bar - d)) / (2.0 * STEP) for d in moves],
            axis=1,
        )


def twist_free(direction: Array) -> Array:
    """The rotation that tilts e3 to a direction about their common normal."""
    normal = np.cross([0.0, 0.0, 1.0], direction)
    sine = float(np.linalg.norm(normal))
    angle = float(np.arctan2(sine, direction[2]))
    turn: Array = Rotation.from_rotvec(normal / sine * angle if sine > 0.0 else normal).as_matrix()
    return turn


def pull_inside(engine: RodSolver, bar: Array, slope: Array, at: float = 1e-12) -> Array:
    """What of a slope of a cost is left where pressures may move: inside their limits."""
    limits = engine.setup.limits
    left = np.where(bar <= limits.lower + at, np.minimum(slope, 0.0), slope)
    return np.where(bar >= limits.upper - at, np.maximum(left, 0.0), left)
