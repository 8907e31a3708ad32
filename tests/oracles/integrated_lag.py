"""Commands behind a dead time and a lag, integrated by scipy on a fine grid: an oracle of identification."""

from __future__ import annotations

import numpy as np
from scipy.signal import lsim

from contid.kinematics.array import Array

#: Of the commands, and of the grid [s].
PERIOD_S = 0.01
FINE_S = 1e-4


def integrated(sent: Array, at_s: Array, delay_s: float, lag_s: float) -> Array:
    """Held commands, late, through a lag, by `scipy.signal.lsim` at 10 kHz, at times ``at_s``."""
    grid = np.arange(float(int(len(sent) * PERIOD_S / FINE_S))) * FINE_S
    place = np.floor((grid - delay_s) / PERIOD_S + 1e-9).astype(int)
    held = sent[np.clip(place, 0, len(sent) - 1)]
    _, out, _ = lsim(([1.0], [lag_s, 1.0]), held - sent[0], grid, interp=False)
    return np.asarray(np.interp(at_s, grid, out + sent[0]))


def exciting_commands(seed: int, duration_s: float, size: float, velocity: float) -> Array:
    """Steps of random size with limited speed, as an axis is moved: ``(ticks,)``."""
    rng = np.random.default_rng(seed)
    goals: list[float] = []
    out: list[float] = []
    value = 0.0
    while len(goals) < duration_s / PERIOD_S:
        goals += [rng.uniform(-size, size)] * int(rng.integers(20, 120))
    for goal in goals[: int(duration_s / PERIOD_S)]:
        value += float(np.clip(goal - value, -velocity * PERIOD_S, velocity * PERIOD_S))
        out.append(value)
    return np.array(out)
