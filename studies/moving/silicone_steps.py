"""Steps of pressure in one silicone chamber by a model of eight numbers, beside an interpolation.

``CONTID_SHARED_DATA=.. python -m studies.moving.silicone_steps``

Recordings: srl-ethz/diffPD_sim2real at commit 825e7b7 (MIT, (c) 2021 Soft Robotics Lab, ETH Zurich),
repacked: twelve steps of 1.5 s at 100 Hz, three markers on the tip, of which the mean is predicted. The
split, set beforehand: 100, 225 and 325 mbar are kept out. The frame of each step is that of the first motion.

    z(t) = a p / (1 - p / p0) (swing(t) + c / (1 - p / p0) (1 - exp(-t / tau))),   x = -k z - l z^2

The body is softer the more it is blown up, and the creep c grows with that: c / (1 - p / p0). y is
constant. Numbers: a, p0, c, tau, f, damping ratio, k and l.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from contid.kinematics.array import Array
from studies.moving.recordings import columns, table

KEPT_OUT_MBAR: Final = (100.0, 225.0, 325.0)
#: A step has begun where the tip moved this far [mm].
MOVED_MM: Final = 0.3
PERIOD_S: Final = 0.01


def steps() -> dict[float, tuple[Array, int]]:
    """Tips about their rest ``(frames, 3)`` [mm], and the frame of the step, by pressure [mbar]."""
    of = table("pneumatic-step/steps.csv.gz")
    markers = [columns(of, [f"{axis}{marker}_mm" for axis in "xyz"]) for marker in (5, 6, 7)]
    tips = np.mean(markers, axis=0)
    out = {}
    for pressure in np.unique(of["pressure_mbar"]):
        tip = tips[of["pressure_mbar"] == pressure]
        tip = tip - tip[:5].mean(axis=0)
        start = int(np.argmax(np.linalg.norm(tip, axis=1) > MOVED_MM)) - 1
        out[float(pressure)] = (tip, start)
    return out


def tip_of(numbers: Array, mbar: float, since_s: Array) -> Array:
    """Tip ``(n, 3)`` [mm] at times since the step."""
    a, p0, creep, tau_s, hz, ratio, side, turn = numbers.tolist()
    since = np.maximum(since_s, 0.0)
    soft = max(1.0 - mbar / (1e3 * p0), 1e-3)
    rate = 2.0 * np.pi * hz
    damped = rate * np.sqrt(1.0 - ratio**2)
    fade = np.exp(-ratio * rate * since)
    swing = 1.0 - fade * (np.cos(damped * since) + ratio * rate / damped * np.sin(damped * since))
    z = 1e-2 * a * mbar / soft * (swing + creep / soft * (1.0 - np.exp(-since / tau_s)))
    tip: Array = np.zeros((len(since), 3))
    tip[:, 0], tip[:, 2] = -side * z - 1e-2 * turn * z**2, z
    return tip


def rmse(errors: Array) -> float:
    """Root mean square of distances."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def report() -> Iterator[str]:
    """The table."""
    data = steps()
    fitted = {mbar: each for mbar, each in data.items() if mbar not in KEPT_OUT_MBAR}

    def since(mbar: float) -> Array:
        tip, start = data[mbar]
        return np.asarray((np.arange(float(len(tip))) - start) * PERIOD_S)

    def left(numbers: Array) -> Array:
        return np.concatenate(
            [(tip - tip_of(numbers, p, since(p))).ravel() for p, (tip, _) in fitted.items()]
        )

    start = np.array([2.0, 0.6, 0.1, 0.5, 9.0, 0.3, 0.3, 1.3])
    low, high = np.full(8, 1e-3), np.array([50.0, 5.0, 2.0, 10.0, 30.0, 0.95, 5.0, 50.0])
    found = least_squares(left, start, bounds=(low, high), x_scale=start)
    names = ("a [mm/100 mbar]", "p0 [bar]", "c", "tau [s]", "f [Hz]", "ratio", "k", "l [1/(100 mm)]")
    yield ", ".join(f"{name} {value:.3g}" for name, value in zip(names, found.x, strict=True))
    yield f"fitted steps: {rmse(left(found.x).reshape(-1, 3)):.2f} mm"
    for mbar in KEPT_OUT_MBAR:
        tip, _ = data[mbar]
        below, above = max(p for p in fitted if p < mbar), min(p for p in fitted if p > mbar)
        share = (mbar - below) / (above - below)
        between = sum(
            weight * np.stack([np.interp(since(mbar), since(p), column) for column in data[p][0].T], axis=1)
            for p, weight in ((below, 1.0 - share), (above, share))
        )
        yield (
            f"{mbar:.0f} mbar, kept out: {rmse(tip - tip_of(found.x, mbar, since(mbar))):.2f} mm of "
            f"{np.linalg.norm(tip, axis=1).max():.1f} mm; interpolated {rmse(tip - between):.2f} mm"
        )


if __name__ == "__main__":
    for line in report():
        print(line)  # noqa: T201
