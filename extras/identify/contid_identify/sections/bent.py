"""The tip of an arm of sections from its axes: what is linear, what stiffens, what a payload takes.

    y_j      axis j about its middle, swung, in spreads
    l_k      sum over axes of g_jk y_j: bend of section k, two numbers, as if every section were free
    b_i      r_i + sum over axes of g_ji (y_j + c_j y_j^3) - sum over sections j, k of a_ijk |l_j| l_k
             - s sum over sections k of (p_ik l_k) - s q_i
    tip      arcs of these bends behind each other

Tendons of one section run through those before it: where a section is bent, they are tight and brace what
they pass. Only the size of a bend counts for that, not its direction: a round arm has no preferred side, so
one number ``a_ijk`` acts alike on both directions of a bend. ``s`` is the effect of a payload
(`contid_identify.tip_motion`). The fit is `contid_identify.sections.fit`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_identify.sections.arcs import chained

#: |l| is a root of squares with this one, so that it has a slope at 0 [rad].
_ROUND_RAD: Final = 1e-3


@dataclass(frozen=True, eq=False)
class ArmSections:
    """What is known of an arm of sections without a recording.

    Attributes:
        length_m: of the sections, from the base on, ``(sections,)``.
        link_m: of the straight part behind each, ``(sections,)``; the last one ends at the tip.
        bends_by_axes: bends by commands ``(sections, 2, axes)`` [rad per m or Pa].
        rest: bends without commands ``(sections, 2)`` [rad].
        base_m: where the first section begins, ``(3,)``.
        frame: axes of that section at its beginning as columns, in the frame of the tips, ``(3, 3)``.
    """

    length_m: Array
    link_m: Array
    bends_by_axes: Array
    rest: Array
    base_m: Array
    frame: Array


@dataclass(frozen=True, eq=False)
class BentSections:
    """The map from inputs to tips.

    Attributes:
        length_m, link_m, base_m, frame: see `ArmSections`.
        axes_by_inputs: axes in spreads by inputs of the map, ``(axes, inputs)``.
        gains: bends by axes ``(axes, sections, 2)`` [rad].
        cubes: ``c``, ``(axes,)``.
        rest: bends in the middle of the commands ``(sections, 2)`` [rad].
        braced: ``a``, ``(sections, sections, sections)`` [1/rad].
        softer: ``p``, ``(sections, sections)`` [1/kg].
        sag: ``q``, ``(sections, 2)`` [rad/kg].
        cube_halves, braced_halves: half of the 95 % intervals of ``cubes`` and ``braced``.
    """

    length_m: Array
    link_m: Array
    base_m: Array
    frame: Array
    axes_by_inputs: Array
    gains: Array
    cubes: Array
    rest: Array
    braced: Array
    softer: Array
    sag: Array
    cube_halves: Array
    braced_halves: Array

    def tips(self, inputs: Array, effect_kg: float) -> Array:
        """Tips ``(samples, 3)`` [m] of inputs ``(samples, inputs)`` under a payload's effect."""
        return self.placed(self.bends(inputs, effect_kg))

    def free(self, y: Array) -> Array:
        """Bends ``(samples, sections, 2)`` [rad] of axes ``(samples, axes)`` as if sections were free."""
        return np.asarray(np.einsum("na,akc->nkc", y, self.gains))

    def bends(self, inputs: Array, effect_kg: float) -> Array:
        """Bends ``(samples, sections, 2)`` [rad]."""
        y = inputs @ self.axes_by_inputs.T
        free = self.free(y)
        braced = np.einsum("ijk,nj,nkc->nic", self.braced, sizes(free), free)
        loaded = effect_kg * (np.einsum("ik,nkc->nic", self.softer, free) + self.sag)
        return np.asarray(self.rest + self.free(y + self.cubes * y**3) - braced - loaded)

    def placed(self, bends: Array) -> Array:
        """Tips ``(samples, 3)`` [m] of bends."""
        lengths = np.broadcast_to(self.length_m, bends.shape[:2])
        return np.asarray(self.base_m + chained(bends, lengths, self.link_m) @ self.frame.T)


def sizes(bends: Array) -> Array:
    """How far sections are bent ``(samples, sections)`` [rad], of bends ``(samples, sections, 2)``."""
    return np.asarray(np.sqrt((bends**2).sum(axis=2) + _ROUND_RAD**2))
