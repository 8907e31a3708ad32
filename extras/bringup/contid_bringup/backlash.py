"""Backlash of a geared motor whose encoder is behind the gear, from pulses in pairs.

A pulse against the direction of the one before crosses the backlash before the encoder moves; the second of
the same duty and duration does not. While the motor crosses, its own inertia and friction are what it turns
anyway, so the two ways differ by the backlash. An encoder on the motor's own shaft does not see it.
"""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np

from contid_bringup.drive_fit import DURATIONS_S, MeanOfPulses
from contid_bringup.probing import DUTY_MOST, Pulse, from_rest
from contid_devices.pulsed_motors import DriveFacts

_PAIRS: Final = 8
#: Standard deviation of the difference of two ways, each rounded at both ends [counts].
_ROUNDED: Final = math.sqrt(4.0 / 12.0)


def measure_backlash(pulse: Pulse, facts: DriveFacts) -> MeanOfPulses | None:
    """Backlash [deg]; None when a fault ended the pulses, or when a pulse does not cross it.

    Args:
        pulse: of a proven motor.
        facts: what the robot file states about it.
    """
    pulse = from_rest(pulse)
    durations = itertools.cycle(DURATIONS_S)
    pulse(DUTY_MOST, next(durations))
    differences = []
    for sign in (-1.0, +1.0) * (_PAIRS // 2):
        duration_s = next(durations)
        back, on = (pulse(sign * DUTY_MOST, duration_s) for _ in range(2))
        if back.fault or on.fault or sign * back.own.counts < 1:
            return None
        differences.append(sign * (on.own.counts - back.own.counts))
    per_deg = facts.counts_per_rev / 360.0
    spread = max(float(np.std(differences, ddof=1)), _ROUNDED) / math.sqrt(_PAIRS)
    return MeanOfPulses(float(np.mean(differences)) / per_deg, spread / per_deg)
