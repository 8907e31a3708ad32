"""Friction of tendons: their play, and pulls that lead the capstan so that the bends are those asked for.

Play (backlash) of half width r: what arrives follows what is commanded at most r behind,

    delivered' = min(commanded + r, max(commanded - r, delivered)),

the state is the value delivered last (Brokate, Sprekels: Hysteresis and Phase Transitions, 1996, 2.1).
`contid.control.tick.play` leads it.

A tendon that slides over a bend theta keeps exp(-+ mu theta) of its tension (- while it is pulled in, + while
it is paid out: the capstan). With the tension t at its spool, the share of it that is left on the average of
section k is

    f_k = exp(-sum over m < k of mu_m sigma_m theta_m) (1 - exp(-x)) / x,      x = mu_k sigma_k theta_k,

sigma = 1 where it is pulled in there, -1 where it is paid out. Bends stay where the moments stay: from the
last section to the first the tendons of section j carry what the others leave,

    sum over own tendons of f_j t arms = K_j Theta_j - sum over tendons passing of f_j t arms,

and are tightened until the least tension on their way is as far above the floor as without friction. A spool
then winds the difference of tension over the stiffness of its tendon. With mu = 0 the difference is 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.tendon.tension import TendonStatics
from contid.targets import Actuation


def play(commanded: Array | float, delivered: Array | float, half_width: Array | float) -> Array:
    """What arrives [m] for a command [m], from what arrived last [m]; elementwise."""
    return np.minimum(
        np.add(commanded, half_width), np.maximum(np.subtract(commanded, half_width), delivered)
    )


#: A tendon turns its friction over while it slides back by twice this length [m]: above rounding of commands,
#: below what a servo resolves.
TURNING_M: Final = 1e-5


class CapstanLead:
    """The lead of one robot.

    Args:
        statics: statics of the robot.
        coefficients: mu of each section.
    """

    def __init__(self, statics: TendonStatics, coefficients: Sequence[float]) -> None:
        geometry = statics.geometry
        self._statics = statics
        self._mu = np.array(coefficients)
        self._sections, self._tendons = geometry.count, geometry.tendons
        own = geometry.section_of
        first = np.zeros(geometry.tendons, dtype=int) if geometry.through else own
        sections = np.arange(geometry.count)
        #: Where each tendon passes, and its moment there per tension.
        self._passes = (first[:, None] <= sections) & (sections <= own[:, None])
        self._arms = geometry.pull_matrix.reshape(geometry.tendons, geometry.count, 2)
        # A tendon slides at the middle of section k by what the sections beyond shorten, and half of its own.
        weight = np.where(sections[:, None] < sections, 1.0, np.where(np.eye(len(sections)) > 0.0, 0.5, 0.0))
        self._slid = np.einsum("km,imc->ikmc", weight, self._arms).reshape(
            self._tendons * self._sections, 2 * self._sections
        )
        self._back = [np.linalg.pinv(geometry.sections[j].arms.T) for j in range(geometry.count)]
        self._moments = np.repeat(statics.bending_nm, 2)

    def slides(self, before: Actuation, pulls: Actuation, steps: Actuation) -> Actuation:
        """Sense of sliding of every tendon in every section, -1 to 1, after a step of the pulls [m].

        Args:
            before: state after the tick before; empty before the first.
            pulls: after the step.
            steps: the step.
        """
        old = np.array(before) if before else np.zeros(self._tendons * self._sections)
        slid = self._slid @ (self._statics.bends_by_pulls @ np.array(steps[: self._tendons]))
        return tuple(np.clip(old + slid / TURNING_M, -1.0, 1.0).tolist())

    def lead(self, pulls: Actuation, slides: Actuation) -> Array:
        """What spools wind beyond ``pulls`` ``(tendons,)`` [m], cut so that no tension exceeds its limit."""
        statics = self._statics
        asked = np.array(pulls[: self._tendons])
        bends, tensions = statics.bends(asked), statics.tensions(asked)
        sense = np.array(slides).reshape(self._tendons, self._sections)
        more = self._tensions(bends, tensions, sense) - self._tensions(bends, tensions, 0.0 * sense)
        rises = more > 0.0
        room = np.maximum(statics.limit_n - tensions[rises], 0.0)
        share = min(1.0, float(np.min(room / more[rises]))) if rises.any() else 1.0
        lead: Array = share * more / statics.tendon_n_per_m
        return lead

    def _tensions(self, bends: Array, tensions: Array, sense: Array) -> Array:
        """Tensions at the spools [N] with which the bends [rad] are in balance while tendons slide."""
        statics = self._statics
        turned = np.hypot(bends[0::2], bends[1::2])
        x = self._passes * sense * self._mu * turned
        after = np.exp(-np.cumsum(x, axis=1))  # share that is left at the end of each section
        start = np.hstack((np.ones((self._tendons, 1)), after[:, :-1]))
        mean = start * np.where(np.abs(x) < 1e-9, 1.0, -np.expm1(-x) / np.where(x == 0.0, 1.0, x))
        least = np.minimum(1.0, np.min(np.where(self._passes, after, 1.0), axis=1))
        out = np.zeros(self._tendons)
        carried = np.zeros((self._sections, 2))
        for j in range(self._sections - 1, -1, -1):
            rows = statics.geometry.tendon_slices[j]
            free, share = statics.slack_free[rows], mean[rows, j]
            needed = self._moments[2 * j : 2 * j + 2] * bends[2 * j : 2 * j + 2] - carried[j]
            inside = self._back[j] @ needed
            tight = float(np.min((tensions[rows] - statics.floor_n) / free))
            floor = (statics.floor_n + tight * free) * share / least[rows]
            inside = inside + float(np.max((floor - inside) / free)) * free
            out[rows] = inside / share
            carried += np.einsum("i,ik,ikc->kc", out[rows], mean[rows], self._arms[rows])
        return out
