"""Least delay of a contact by the noise of the tracker alone: ``python -m tests.sense.contact_bound``.

The matched filter (Neyman and Pearson) of a tip that a wall holds back by v (t - t0) along a known direction,
with all else known: arm, load, hysteresis, speed and the time of the touch. In white noise no detector with
as few false alarms is earlier; after n measurements it sees a touch with the probability

    P = Phi(sqrt(sum_k (v (t_k - t0))^2) / sigma - z),      Phi(-z): false alarms in a test.
"""

from __future__ import annotations

import sys
from statistics import NormalDist

import numpy as np

TRACKER_HZ, SIGMA_MM, LATENCY_S = 50.0, 0.3, 0.010
#: One false alarm in an hour of tests, one per measurement.
FALSE_ALARMS = 1.0 / (3600.0 * TRACKER_HZ)


def delays_s(speed_mm_s: float, phases: int = 50, false_alarms: float = FALSE_ALARMS) -> np.ndarray:
    """Quantiles of the delay from the touch to the arrival of the measurement that shows it."""
    normal = NormalDist()
    z = -normal.inv_cdf(false_alarms)
    levels = (np.arange(phases) + 0.5) / phases
    found = []
    for first in levels / TRACKER_HZ:  # when the first measurement after the touch is captured
        times = first + np.arange(400) / TRACKER_HZ
        energy = np.cumsum((speed_mm_s * times / SIGMA_MM) ** 2)
        seen = np.array([normal.cdf(root - z) for root in np.sqrt(energy)])
        found += [times[np.argmax(seen >= level)] + LATENCY_S for level in levels]
    return np.sort(found)


if __name__ == "__main__":
    for speed in [float(each) for each in sys.argv[1:]] or [5.0, 20.0, 70.0]:
        p5, p50, p95 = 1e3 * np.quantile(delays_s(speed), [0.05, 0.5, 0.95])
        print(f"{speed:g} mm/s: p5 {p5:.0f}, p50 {p50:.0f}, p95 {p95:.0f} ms from the touch")
