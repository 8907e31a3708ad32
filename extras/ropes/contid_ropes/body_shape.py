"""The shape of a body in the world: by its model from an actuation, or by a quintic from its measured ends.

The quintic needs no model: base and tip, the directions there and optionally the length (Singh et al., IROS
2018). Its accuracy is in docs/robots/ph-curves.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array, polyline_length
from contid.kinematics.frames import BaseFrame, in_world
from contid.kinematics.model import Model
from contid.targets import ZERO3, Actuation, Tip, Vec3
from contid_ropes.chain import ChainGuard
from contid_ropes.ph.ends import CurveEnds, least_energy, plausible_energy, through

#: Enough segments that a polyline, extrapolated, has the length of the curve to a millionth.
FINE: Final = 1024
#: Direction in the base frame along which a planar body (2) and a spatial one (3) start.
GROWS_ALONG: Final[dict[int, Vec3]] = {2: (0.0, 1.0, 0.0), 3: (0.0, 0.0, 1.0)}


@dataclass(frozen=True, eq=False)
class BodyShape:
    """A backbone.

    Attributes:
        points_in_world: points at equal arc length from base to tip, shape ``(n, 3)`` [m].
        length_m: length of the backbone [m].
        tip_direction_in_world: unit tangent at the tip.
        note: one sentence when the length could not be met.
    """

    points_in_world: Array
    length_m: float
    tip_direction_in_world: Vec3
    note: str = ""

    @property
    def tip(self) -> Tip:
        """Tip [m] and direction there, in the world."""
        x, y, z = self.points_in_world[-1].tolist()
        return (x, y, z), self.tip_direction_in_world

    @property
    def s_m(self) -> Array:
        """Arc length of every point [m], shape ``(n,)``."""
        return np.linspace(0.0, self.length_m, len(self.points_in_world))


def by_model(
    model: Model, frame: BaseFrame, actuation: Actuation, points: int, load_in_world: Vec3 = ZERO3
) -> BodyShape:
    """The model's backbone for an actuation [m or Pa] and a known force on the tip [N]."""
    load = frame.vector_in_base(load_in_world)
    fine = model.shape(actuation, FINE + 1, load)
    # Chords are short by the square of their size: two polylines give the curve (Richardson).
    length = (4.0 * polyline_length(fine) - polyline_length(fine[::2])) / 3.0
    direction = frame.vector_in_world(model.forward(actuation, load).direction)
    return BodyShape(in_world(frame, model.shape(actuation, points, load)), length, direction)


def from_pose(
    frame: BaseFrame,
    tip_in_world: Vec3,
    direction_in_world: Vec3,
    points: int,
    length_m: float | None = None,
    dimension: int = 3,
    *,
    rough: bool = False,
) -> BodyShape:
    """The quintic from the base to a measured pose of the tip.

    With a length, the branch of least energy (needed above 180 degrees); without one, the curve whose end
    speed is its mean speed, accurate up to about 150 degrees. ``rough``: the pose is noisy and the length is
    known to about 1 %; it is ignored where its curve has an implausible energy (`plausible_energy`).
    """
    tip, direction = frame.point_in_base(tip_in_world), frame.vector_in_base(direction_in_world)
    ends = CurveEnds(ZERO3, tip, GROWS_ALONG[dimension], direction)
    fit = through(ends) if length_m is None else least_energy(ends, length_m)
    if rough and length_m is not None:
        free = through(ends)
        if fit.energy_per_m > plausible_energy(free, length_m):
            fit = free
    curve = in_world(frame, fit.curve.evenly(points))
    return BodyShape(curve, fit.curve.length_m, direction_in_world, fit.note)


def of_rope(guard: ChainGuard, bodies: Mapping[str, BodyShape], points: int) -> BodyShape:
    """The rope of a chain between the tips of its arms.

    Raises:
        ValueError: it does not reach.
    """
    tips = {arm: bodies[arm].tip for arm in guard.arms}
    state, fits = guard.check(tips), guard.curves(tips)
    if not fits:
        raise ValueError(f"{guard.name}: {state.reason}")
    x, y, z = fits[-1].curve.tangent(np.ones(1))[0].tolist()
    length = sum(fit.curve.length_m for fit in fits)
    return BodyShape(guard.points(tips, points), length, (x, y, z), state.reason)
