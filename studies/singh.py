"""Newton-Raphson and damped least squares of Singh et al. (ROBIO 2017), and the trajectory to compare them.

All methods work on the corrected kinematics (`contid.kinematics.arc.sections`). What is compared is the
bookkeeping:

* Newton-Raphson, Eq. 8-9: ``l <- l + J^T (J J^T)^-1 (target - FK(l))`` until the error is below a tolerance.
  Eq. 9 has a minus because its J is dE/dl = -dP/dl (Eq. 7); the printed limits by "fmincon" are left out.
* Damped least squares, Eq. 11-13: one step ``dl = J^T (J J^T + lambda^2 I)^-1 de`` per point. The paper takes
  ``de`` from the previous *trajectory point*, not from where the arm is: an open loop, in which linearisation
  error and the damping loss sigma^2/(sigma^2 + lambda^2) accumulate. Feeding back FK(l) is the cure; a
  smaller lambda is not.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.arc.sections import Sections
from contid.kinematics.array import Array
from contid.targets import Vec3
from studies.arc_chains import differentiate, forward

# Constants of the golden trajectory (simulated; no robot data exist in either paper).
_FA: Final = (1.3, 0.9, 1.7, 1.1, 0.7, 1.5)
_PA: Final = (0.3, 2.1, 4.4, 5.2, 1.2, 3.3)
_FB: Final = (2.3, 2.9, 1.9, 3.1, 2.7, 2.1)
_PB: Final = (1.0, 0.2, 5.5, 2.6, 4.0, 0.9)
LOWER_M: Final = (0.100,) * 3 + (0.090,) * 3
UPPER_M: Final = (0.150,) * 3 + (0.140,) * 3


def cbha_sections() -> Sections:
    """The reference's CBHA: tubes at 180, 60, -60 degrees, 40 and 32 mm from the backbone (placeholders)."""
    angles = (math.pi, math.pi / 3.0, -math.pi / 3.0)
    return Sections((0.040, 0.032), (angles, angles), (0.0, 0.0))


@dataclass(frozen=True, slots=True)
class TubeTrajectory:
    """Tube lengths ``(points, 6)`` and the tips ``(points, 3)`` they reach [m]."""

    lengths_m: Array
    tips_m: Array


def trajectory(
    fa: Sequence[float],
    pa: Sequence[float],
    fb: Sequence[float],
    pb: Sequence[float],
    tau: Array | None = None,
) -> TubeTrajectory:
    """A trajectory from pressures that are sums of two sines per tube.

    ``p = 0.75 + 0.45 sin(2 pi FA tau + PA) + 0.25 sin(2 pi FB tau + PB)`` bar, tau in [0, 1], and
    ``l = lo + (hi - lo) s(p/1.5)`` with ``s(x) = x (1 + 0.3 (1 - x))``.
    """
    turn = 2.0 * np.pi * (np.arange(100) / 99 if tau is None else tau)[:, None]
    pressure = 0.75 + 0.45 * np.sin(np.array(fa) * turn + np.array(pa))
    pressure = pressure + 0.25 * np.sin(np.array(fb) * turn + np.array(pb))
    lengths = lengths_at(pressure)
    return TubeTrajectory(lengths, forward(cbha_sections(), lengths).tip)


def lengths_at(pressure_bar: Array) -> Array:
    """Tube lengths [m], shape ``(..., 6)``, for pressures from 0 to 1.5 bar: the reference's invented map."""
    x = pressure_bar / 1.5
    low, high = np.array(LOWER_M), np.array(UPPER_M)
    lengths: Array = low + (high - low) * x * (1.0 + 0.3 * (1.0 - x))
    return lengths


def golden_trajectory(tau: Array | None = None) -> TubeTrajectory:
    """The 100 points every method is compared on, mean step 4.2 mm; or the same curve at other ``tau``."""
    return trajectory(_FA, _PA, _FB, _PB, tau)


def golden_rows(period_s: float, laps: float, rate_hz: float) -> Iterator[tuple[float, Vec3]]:
    """The golden trajectory to follow: times [s] and tips [m], there in odd laps and back in even ones."""
    last = math.ceil(laps * period_s * rate_hz - 1e-9)
    times = np.arange(last + 1) / rate_hz
    within = np.minimum(times / period_s, laps) % 2.0
    tips = golden_trajectory(np.where(within <= 1.0, within, 2.0 - within)).tips_m
    for time_s, tip in zip(times.tolist(), tips.tolist(), strict=True):
        yield time_s, (tip[0], tip[1], tip[2])


def random_trajectory(rng: np.random.Generator) -> TubeTrajectory:
    """A trajectory of the same family with random frequencies and phases."""
    slow, fast = rng.uniform(0.5, 2.0, 6).tolist(), rng.uniform(1.5, 3.5, 6).tolist()
    phases = rng.uniform(0.0, 2.0 * np.pi, (2, 6)).tolist()
    return trajectory(slow, phases[0], fast, phases[1])


def damped(J: Array, error: Array, damping: float = 0.0) -> Array:
    """``J^T (J J^T + damping^2 I)^-1 error``, for one posture or many: ``(..., 3, 6)`` and ``(..., 3)``."""
    turned = np.swapaxes(J, -1, -2)
    return (turned @ np.linalg.solve(J @ turned + damping**2 * np.eye(3), error[..., None]))[..., 0]


def newton_raphson(
    sections: Sections, target_m: Array, lengths: Array, tolerance_m: float = 1e-6, most: int = 50
) -> tuple[Array, int]:
    """Eq. 8-9 for one target: lengths [m] and the number of updates; unbounded, as the paper's update is."""
    for updates in range(most):
        at = differentiate(sections, lengths)
        error = target_m - at.frames.tip
        if float(np.linalg.norm(error)) <= tolerance_m:
            return lengths, updates
        lengths = lengths + damped(at.tip, error)
    return lengths, most


def newton_raphson_path(
    sections: Sections, tips_m: Array, lengths: Array, tolerance_m: float = 1e-6, most: int = 50
) -> Array:
    """Eq. 8-9 along paths ``(..., points, 3)``, each point from the one before: ``(..., points, 6)``."""
    found = [lengths]
    for k in range(1, tips_m.shape[-2]):
        present = found[-1]
        for _ in range(most):
            at = differentiate(sections, present)
            error = tips_m[..., k, :] - at.frames.tip
            wrong = np.linalg.norm(error, axis=-1) > tolerance_m
            if not wrong.any():
                break
            present = np.where(wrong[..., None], present + damped(at.tip, error), present)
        found.append(present)
    return np.stack(found, axis=-2)


def dls_as_printed(sections: Sections, tips_m: Array, lengths: Array, damping: float = 0.5) -> Array:
    """Section III-B: one step per point, the previous trajectory point taken for the current one.

    Args:
        sections: the arm.
        tips_m: one path ``(points, 3)`` or many ``(..., points, 3)`` [m].
        lengths: lengths at the first point, ``(..., 6)`` [m].
        damping: lambda; the paper has 0.5.

    Returns:
        Lengths along the path, ``(..., points, 6)``; the first is the start.
    """
    found = [lengths]
    for k in range(1, tips_m.shape[-2]):
        step = tips_m[..., k, :] - tips_m[..., k - 1, :]
        found.append(found[-1] + damped(differentiate(sections, found[-1]).tip, step, damping))
    return np.stack(found, axis=-2)


def dls_with_feedback(
    sections: Sections, tips_m: Array, lengths: Array, damping: float = 0.5, steps: int = 1
) -> Array:
    """The same step with the error taken from FK of the present lengths; ``steps`` of them per point."""
    found = [lengths]
    for k in range(1, tips_m.shape[-2]):
        present = found[-1]
        for _ in range(steps):
            at = differentiate(sections, present)
            present = present + damped(at.tip, tips_m[..., k, :] - at.frames.tip, damping)
        found.append(present)
    return np.stack(found, axis=-2)
