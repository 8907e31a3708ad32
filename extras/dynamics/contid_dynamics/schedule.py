"""The schedule of input shaping: frequencies of a robot's two slowest modes as polynomials of its axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.model import build_model
from contid.robot_file.rates import HIGHEST_HZ, LEAST_STIFFNESS, LOWEST_HZ
from contid.robot_file.robot import RobotDescription
from contid.robot_file.tendon.robot import TendonRobot
from contid.targets import Target
from contid.units import DEG
from contid_dynamics.arm import MovingArm
from contid_dynamics.report import pose_arm

#: One pose in this many is kept out of the fit, which is judged by it.
_KEPT_OUT: Final = 4
#: Directions of the terms with less than this share of the spread of the greatest are left out: the pulls of
#: one section have a sum that the poses hardly change.
_FLAT: Final = 3e-3
#: Share of the poses whose frequencies may be outside of what shaping takes; they count as at its edge.
_OUTSIDE: Final = 0.1
#: Poses for each of the numbers of a polynomial, at least.
_PER_TERM: Final = 2.0
_DIGITS: Final = 5
#: The shaper cancels swings of the two frequencies, or of these times the one between them where they are
#: nearer: zeros that are apart bear frequencies that are others on the way, and take as long.
_APART: Final = (0.9, 1.1)


@dataclass(frozen=True)
class FoundSchedule:
    """A schedule and how well it fits.

    Attributes:
        shape: the value of ``rates.shape``.
        poses: how many it was fitted to.
        outside: how many of all swing slower or faster than shaping takes, and count as at its edge.
        kept_out: how many it was compared with.
        median, worst: error of the first and second frequency on those, as shares, with and without load.
    """

    shape: dict[str, Any]
    poses: int
    outside: int
    kept_out: int
    median: tuple[float, float]
    worst: tuple[float, float]


def schedule_of(robot: RobotDescription, poses: int, load_g: float = 0.0, seed: int = 1) -> FoundSchedule:
    """Fit the two slowest frequencies over random poses.

    Args:
        robot: with ``dynamics``.
        poses: how many; a fourth of them is kept aside.
        load_g: greatest mass on the tip, besides that of ``dynamics``; 0 for one that never changes.
        seed: of the poses.

    Raises:
        ContidError: it has no moving body, swings too slowly, or there are too few poses.
    """
    axes = len(robot.axis_names)
    terms = 1 + axes + axes * (axes + 1) // 2
    if poses < _PER_TERM * terms:
        raise ContidError(f"--schedule {poses}: {axes} axes need at least {round(_PER_TERM * terms)} poses")
    at_rest = np.array(robot.rest[:axes])
    actuations = np.vstack((random_actuations(robot, poses - 1, seed, spread=True), at_rest))
    # By what factor more elements change the frequencies at rest, they change those of other poses: (1, 2).
    finer = _frequencies(pose_arm(robot), at_rest[None, :]) / _frequencies(MovingArm(robot), at_rest[None, :])
    free = finer * _frequencies(MovingArm(robot), actuations)
    loaded = finer * _frequencies(MovingArm(robot, load_g * 1e-3), actuations) if load_g else free
    known = np.isfinite(free).all(axis=1) & np.isfinite(loaded).all(axis=1)
    actuations, free, loaded = actuations[known], free[known], loaded[known]
    kept = np.arange(len(free)) % _KEPT_OUT == 0
    if len(free[~kept]) < terms:
        raise ContidError(f"the model has an equilibrium at {len(free)} of {poses} poses only; ask for more")
    values = robot.quantity.from_si(actuations)
    low, high = values.min(axis=0), values.max(axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-6)
    rows = _terms((values - middle) / half)
    least, most = (float(each) for each in (min(free.min(), loaded.min()), max(free.max(), loaded.max())))
    both = np.hstack((free, loaded))
    outside = int(((both < LOWEST_HZ) | (both > HIGHEST_HZ)).any(axis=1).sum())
    if outside > _OUTSIDE * len(both):
        raise ContidError(
            f"frequencies of {least:.3g} to {most:.3g} Hz; shaping takes {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz, "
            f"and {outside} of {len(both)} poses are outside"
        )
    free, loaded = (np.clip(_apart(each), LOWEST_HZ, HIGHEST_HZ) for each in (free, loaded))
    least, most = (float(each) for each in (min(free.min(), loaded.min()), max(free.max(), loaded.max())))
    fitted = _best_fit(rows, free, ~kept)
    slower = _fit(rows[~kept], (free / loaded)[~kept] ** 2 - 1.0) if load_g else None
    schedule: dict[str, Any] = {
        "middle": _digits(middle),
        "half": _digits(half),
        "least_hz": float(f"{least:.4g}"),
        "most_hz": float(f"{most:.4g}"),
        "polynomials": fitted.polynomials,
        "first": _digits(fitted.numbers[:, 0]),
        "second": _digits(fitted.numbers[:, 1]),
    }
    if slower is not None:
        schedule |= {
            "load_g": load_g,
            "first_loaded": _digits(slower[:, 0]),
            "second_loaded": _digits(slower[:, 1]),
        }
    predicted = fitted.frequencies[kept]
    errors = [np.abs(predicted / free[kept] - 1.0)]
    if slower is not None:
        under = predicted / np.sqrt(np.maximum(LEAST_STIFFNESS, 1.0 + rows[kept] @ slower))
        errors.append(np.abs(under / loaded[kept] - 1.0))
    error = np.concatenate(errors)
    return FoundSchedule(
        {"kind": "zvd", **_at_rest(robot), "schedule": schedule},
        int((~kept).sum()),
        outside,
        int(kept.sum()),
        (float(np.median(error[:, 0])), float(np.median(error[:, 1]))),
        (float(error[:, 0].max()), float(error[:, 1].max())),
    )


def random_actuations(
    robot: RobotDescription, count: int, seed: int, share: float = 1.0, spread: bool = False
) -> Array:
    """Random actuations ``(count, axes)`` [m or Pa]: of a tendon robot from bends of its sections.

    Args:
        robot: of the file.
        count: how many.
        seed: of the generator.
        share: of the greatest bend, or of the range of the pressures.
        spread: scale each pose by a random factor: few poses of random sections are nearly straight.
    """
    rng = np.random.default_rng(seed)
    low, high = np.array(robot.lower), np.array(robot.upper)
    if not isinstance(robot, TendonRobot):
        pressures: Array = low + rng.random((count, len(low))) * share * (high - low)
        return pressures
    model = build_model(robot.model_copy(update={"residual": None, "friction": None, "rod": None}))
    sections = len(robot.section_lengths)
    greatest = share * np.array(robot.per_section(robot.limits.bend_max_deg)) * DEG
    found: list[tuple[float, ...]] = []
    for _ in range(20 * count):
        bend, towards = greatest * rng.random(sections), rng.uniform(-np.pi, np.pi, sections)
        if spread:
            bend *= rng.random()
        arcs = np.column_stack((bend * np.cos(towards), bend * np.sin(towards), np.zeros(sections)))
        answer = model.inverse(Target(arcs=tuple(arcs.ravel().tolist())), robot.rest)
        if answer.converged:
            found.append(answer.actuation[: len(low)])
            if len(found) == count:
                return np.array(found)
    raise ContidError(f"only {len(found)} of {20 * count} random poses are within the limits")


def _frequencies(arm: MovingArm, actuations: Array) -> Array:
    """Damped frequencies of the two slowest modes, ``(poses, 2)``; NaN without equilibrium."""
    out = np.full((len(actuations), 2), np.nan)
    for row, actuation in zip(out, actuations.tolist(), strict=True):
        try:
            arm.settle(actuation)
        except ArithmeticError:
            continue
        modes = arm.rod.modes()
        ratio = np.minimum(modes.ratio[:2], 0.95)
        row[:] = modes.frequency_hz[:2] * np.sqrt(1.0 - ratio**2)
    out[out <= 0.0] = np.nan
    return out


def _apart(frequencies: Array) -> Array:
    """The two frequencies ``(poses, 2)`` [Hz], moved apart where they are nearer than `_APART`."""
    between = np.sqrt(frequencies.prod(axis=1))
    return np.column_stack(
        (
            np.minimum(frequencies[:, 0], _APART[0] * between),
            np.maximum(frequencies[:, 1], _APART[1] * between),
        )
    )


def _at_rest(robot: RobotDescription) -> dict[str, float]:
    arm = pose_arm(robot)
    arm.settle(robot.rest[: len(robot.axis_names)])
    modes = arm.rod.modes()
    ratio = min(float(modes.ratio[0]), 0.9)
    hz = float(modes.frequency_hz[0]) * float(np.sqrt(1.0 - ratio * ratio))
    return {"frequency_hz": float(f"{hz:.4g}"), "damping_ratio": float(f"{ratio:.3g}")}


def _terms(shares: Array) -> Array:
    """Terms of a polynomial of degree 2, ``(poses, terms)``: 1, every share and every product of two.

    ``shares`` of the half ranges from their middles, from -1 to 1, ``(poses, axes)``; beyond they end there.
    """
    x: Array = np.maximum(-1.0, np.minimum(1.0, shares))
    axes = x.shape[1]
    pairs = [x[:, i] * x[:, j] for i in range(axes) for j in range(i, axes)]
    return np.column_stack((np.ones(len(x)), *x.T, *pairs))


def _fit(rows: Array, values: Array) -> Array:
    return np.asarray(np.linalg.lstsq(rows, values, rcond=_FLAT)[0], dtype=np.float64)


class _FittedFrequencies(NamedTuple):
    """Value of ``polynomials``, their numbers ``(terms, 2)``, and the frequencies ``(poses, 2)`` [Hz]."""

    polynomials: str
    numbers: Array
    frequencies: Array


def _best_fit(rows: Array, frequencies: Array, own: NDArray[np.bool_]) -> _FittedFrequencies:
    """Logarithms or squared periods, whichever are nearer to the poses ``own`` that both are fitted to.

    Frequencies of a rod have a peak where it is straight, beside which squared periods grow.
    """
    logs = _fit(rows[own], np.log(frequencies[own]))
    # With the least errors of squared periods as shares of them.
    weighted = (rows[own] * each[:, None] for each in frequencies[own].T ** 2)
    periods = np.column_stack([_fit(each, np.ones(len(each))) for each in weighted])
    ends = float(frequencies.max()) ** -2, float(frequencies.min()) ** -2
    fits = (
        _FittedFrequencies("log", logs, np.exp(rows @ logs)),
        _FittedFrequencies("squared_period", periods, np.clip(rows @ periods, *ends) ** -0.5),
    )
    return min(fits, key=lambda fit: float(np.square(fit.frequencies[own] / frequencies[own] - 1.0).mean()))


def _digits(values: Array) -> list[float]:
    return [float(f"{each:.{_DIGITS}g}") for each in values.tolist()]
