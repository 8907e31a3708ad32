"""Stage *ring-down*: frequency and damping of a body that swings freely about a resting command.

    tip(t) = c + sum_m exp(-sigma_m t) (a_m cos w_m t + b_m sin w_m t),   sigma = zeta w / sqrt(1 - zeta^2)

from the moment at which the devices have stopped. c, a and b of every decay follow by linear regression; the
modes are common to the decays that are fitted together. A second mode is kept where it makes Schwarz's
criterion smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid_identify.estimate import Estimate, Interval, estimate
from contid_identify.recording import RobotRecording
from contid_identify.split import decay_blocks

#: A command that changes by less than this share of its span stands still.
_STANDS: Final = 1e-6
#: Commands of one pose differ by less than this share of the span.
_SAME_POSE: Final = 0.02
#: Shortest and longest rest that is used [s].
_LEAST_REST_S: Final = 0.8
_LONGEST_S: Final = 6.0
_LEAST_SAMPLES: Final = 30
#: Amplitude of a swing that is of use, in standard deviations of the noise.
_LEAST_SWING: Final = 5.0
_RATIO: Final = (1e-3, 0.9)
#: A mode that is damped more than this hardly swings; it comes behind those that do.
_CREEPS: Final = 0.5


@dataclass(frozen=True, eq=False)
class Decay:
    """Tips of one rest of the commands.

    Attributes:
        start_s: of the rest in its recording.
        at_s: times since the start of the decay.
        tip_m: shape ``(samples, 3)``.
        amplitude_m: greatest distance from the mean of its last third.
        command: at which the robot rests [m or Pa].
        near: how far apart commands of the same pose may be.
    """

    start_s: float
    at_s: Array
    tip_m: Array
    amplitude_m: float
    command: Array
    near: float


@dataclass(frozen=True, slots=True)
class FreeMode:
    """One mode of a free swing: damped frequency and damping ratio."""

    frequency_hz: Interval
    ratio: Interval


@dataclass(frozen=True, eq=False)
class RingDown:
    """Modes of free swings about one pose.

    Attributes:
        command: at which the robot rests [m or Pa].
        modes: the strongest first, those that hardly swing last.
        decays: how many were used.
        noise_m: what the modes leave over, root mean square of a component.
        range_hz: least and greatest frequency of the strongest mode, decay by decay.
    """

    command: Array
    modes: tuple[FreeMode, ...]
    decays: int
    noise_m: float
    range_hz: tuple[float, float]


def decays_of(recording: RobotRecording, settle_s: float) -> list[Decay]:
    """The rests of a recording behind a move, from ``settle_s`` after its last command on."""
    sent = recording.sent
    span = max(float(np.ptp(sent, axis=0).max()), 1e-300)
    moving = np.flatnonzero((np.abs(np.diff(sent, axis=0)) > _STANDS * span).any(axis=1)) + 1
    ends = np.append(moving, len(sent))
    found = []
    for before, after in pairwise(ends.tolist()):
        start_s = before * recording.period_s + settle_s
        end_s = min(after * recording.period_s, start_s + _LONGEST_S)
        if end_s - start_s < _LEAST_REST_S:
            continue
        rows = (recording.tip_at_s >= start_s) & (recording.tip_at_s < end_s)
        if int(rows.sum()) < _LEAST_SAMPLES:
            continue
        at_s, tip = recording.tip_at_s[rows] - start_s, recording.tip_m[rows]
        rest = tip[-len(tip) // 3 :]
        amplitude = float(np.linalg.norm(tip - rest.mean(axis=0), axis=1).max())
        noise = float(np.sqrt(np.diff(rest, axis=0).var(axis=0).sum() / 2.0))
        if amplitude > _LEAST_SWING * noise:
            found.append(Decay(start_s, at_s, tip, amplitude, sent[before], _SAME_POSE * span))
    return found


def fit_ring_downs(decays: Sequence[Decay]) -> tuple[RingDown, ...]:
    """Frequency and damping of decays, pose by pose: modes change with it.

    Raises:
        ContidError: there is none.
    """
    if not decays:
        raise ContidError(
            "no ring-down: no rest of the commands of 0.8 s or longer with a tip that swings above its "
            "noise; `contid excite --part ring-downs` makes some"
        )
    poses: list[list[Decay]] = []
    for each in decays:
        for pose in poses:
            if np.abs(each.command - pose[0].command).max() <= each.near:
                pose.append(each)
                break
        else:
            poses.append([each])
    poses.sort(key=lambda pose: (-len(pose), -max(each.amplitude_m for each in pose)))
    return tuple(_fit_pose(pose) for pose in poses)


def _fit_pose(decays: Sequence[Decay]) -> RingDown:
    one = _fitted(decays, [_main_frequency(decays)])
    hz = float(np.exp(one.values[0]))
    two = _fitted(decays, [hz, _main_frequency_left(decays, one)])
    found = two if _criterion(two, decays) < _criterion(one, decays) else one
    ranked = sorted(
        range(len(found.values) // 2),
        key=lambda mode: (np.exp(found.values[2 * mode + 1]) > _CREEPS, -_power(decays, found, mode)),
    )
    modes = []
    for mode in ranked:
        before = [0.0] * (2 * mode)
        log_hz, log_ratio = found.interval(*before, 1.0), found.interval(*before, 0.0, 1.0)
        modes.append(FreeMode(log_hz.exponential(), log_ratio.exponential()))
    singly = [float(np.exp(_fitted([each], [modes[0].frequency_hz.value]).values[0])) for each in decays]
    return RingDown(
        decays[0].command,
        tuple(modes),
        len(decays),
        float(np.sqrt((found.residual**2).mean())),
        (min(singly), max(singly)),
    )


def _basis(at_s: Array, parameters: Array) -> Array:
    """Columns of a decay: a constant, then cosine and sine of every mode."""
    columns = [np.ones(len(at_s))]
    for log_hz, log_ratio in parameters.reshape(-1, 2):
        turn = 2.0 * np.pi * np.exp(log_hz) * at_s
        ratio = np.exp(log_ratio)
        fade = np.exp(-ratio / np.sqrt(1.0 - ratio**2) * turn)
        columns += [fade * np.cos(turn), fade * np.sin(turn)]
    return np.column_stack(columns)


def _left(decays: Sequence[Decay], parameters: Array) -> Array:
    found = []
    for each in decays:
        basis = _basis(each.at_s, parameters)
        found.append(each.tip_m - basis @ np.linalg.lstsq(basis, each.tip_m, rcond=None)[0])
    return np.concatenate(found)


def _fitted(decays: Sequence[Decay], frequencies_hz: Sequence[float]) -> Estimate:
    blocks = decay_blocks([len(each.at_s) for each in decays])
    start = np.array([[np.log(hz), np.log(0.1)] for hz in frequencies_hz]).ravel()
    each_low, each_high = np.log([0.2, _RATIO[0]]), np.log([50.0, _RATIO[1]])
    count = len(frequencies_hz)
    return estimate(
        lambda p: _left(decays, p), start, np.tile(each_low, count), np.tile(each_high, count), blocks
    )


def _criterion(found: Estimate, decays: Sequence[Decay]) -> float:
    """Schwarz's criterion; the regressions of every decay count as parameters."""
    samples = found.residual.size
    modes = len(found.values) // 2
    count = len(found.values) + 3 * len(decays) * (1 + 2 * modes)
    return samples * float(np.log(max((found.residual**2).mean(), 1e-300))) + count * float(np.log(samples))


def _power(decays: Sequence[Decay], found: Estimate, mode: int) -> float:
    total = 0.0
    for each in decays:
        basis = _basis(each.at_s, found.values)
        weights = np.linalg.lstsq(basis, each.tip_m, rcond=None)[0]
        own = slice(1 + 2 * mode, 3 + 2 * mode)
        total += float(((basis[:, own] @ weights[own]) ** 2).sum())
    return total


def _main_frequency(decays: Sequence[Decay]) -> float:
    return _spectral_peak(
        [(each.at_s, each.tip_m - each.tip_m[-len(each.tip_m) // 3 :].mean(axis=0)) for each in decays]
    )


def _main_frequency_left(decays: Sequence[Decay], found: Estimate) -> float:
    parts, place = [], 0
    for each in decays:
        parts.append((each.at_s, found.residual[place : place + len(each.at_s)]))
        place += len(each.at_s)
    return _spectral_peak(parts)


def _spectral_peak(parts: Sequence[tuple[Array, Array]]) -> float:
    """The frequency of greatest power over all parts, on their own times [Hz]."""
    step_s = float(np.median(np.concatenate([np.diff(at_s) for at_s, _ in parts])))
    grid = np.geomspace(0.4, min(25.0, 0.4 / step_s), 300)
    power = np.zeros(len(grid))
    for at_s, values in parts:
        wave = np.exp(-2j * np.pi * grid[:, None] * at_s)
        power += (np.abs(wave @ values) ** 2).sum(axis=1)
    return float(grid[int(np.argmax(power))])
