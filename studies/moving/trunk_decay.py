"""Releases of a real tendon trunk beside a moving rod with six numbers: frequency and damping of the tip.

``CONTID_SHARED_DATA=.. python -m studies.moving.trunk_decay``

Recordings: StanfordASL/trunk-stack at commit 8b4b923 (MIT, (c) 2024 Stanford Autonomous Systems Lab),
repacked: 24 releases from bent postures with 200 g and 24 of another set, 100 Hz, three discs of a hose that
hangs down.

The twin is a rod of constant strains (`contid_dynamics.rod`). A release begins at the posture that
the discs show, held by moments of its tendons, which fade to those of the posture at the end. Numbers, fitted
to the tips and the swings of eight releases: stiffness by mass per length at the base [m^4/s^2], mass of the
trunk [kg], damping time [s], dead time and duration of the fading [s], stiffness at the tip by that at the
base. The others are kept out.

Frequency and damping are those of one damped sinusoid, fitted alike to the recording and to the twin, along
the direction from the end to the beginning, from the first passage through the end on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from contid.kinematics.array import Array
from contid_dynamics.rod import STRAINS, MovingElements, MovingRod, spread_mass
from studies.moving.recordings import columns, table

PERIOD_S: Final = 0.01
#: Lengths of the three segments [m] and elements of each.
SEGMENTS: Final = (0.106, 0.097, 0.120)
PER: Final = 2
RADIUS_M: Final = 0.025
#: Shorter releases are of hardly bent postures [m].
LEAST_M: Final = 0.04
SECONDS: Final = 1.6
FITTED: Final = 8
#: What a fitted tip, frequency and damping may be off by: 10 mm, 5 % and 10 %.
TIP_M, HZ_SHARE, RATIO_SHARE = 0.01, 0.05, 0.1
GRAVITY: Final = (0.0, 0.0, 9.81)


class TrunkRelease(NamedTuple):
    """One release, in a frame with z down from the base; discs ``(frames, 3, 3)`` [m]."""

    discs: Array
    payload_kg: float


class DampedSinusoid(NamedTuple):
    """One damped sinusoid."""

    frequency_hz: float
    ratio: float


def releases(name: str, payload_kg: float) -> list[TrunkRelease]:
    """Releases of a file that are long enough, from the frame on in which the tip sets out."""
    of = table(f"trunk-dynamic/{name}.csv.gz")
    discs = np.stack([columns(of, [f"{axis}{k}_mm" for axis in "xzy"]) for k in (1, 2, 3)], axis=1) * 1e-3
    discs[..., 2] *= -1.0
    rest = np.median(np.array([discs[of["id"] == i][-1, 0] for i in np.unique(of["id"])]), axis=0)
    discs = discs - [rest[0], rest[1], 0.0]
    out = []
    for number in np.unique(of["id"]):
        one = discs[of["id"] == number]
        gone = np.linalg.norm(one[:, 2] - one[0, 2], axis=1)
        if gone.max() > LEAST_M:
            start = max(0, int(np.argmax(gone > 1e-3)) - 1)
            out.append(TrunkRelease(one[start : start + round(SECONDS / PERIOD_S)], payload_kg))
    return out


def rod_of(numbers: Array, payload_kg: float) -> MovingRod:
    """The twin with a payload."""
    stiff, mass_kg, damping_s = numbers[:3].tolist()
    lengths = np.repeat(np.array(SEGMENTS) / PER, PER)
    count, per_m = len(lengths), mass_kg / sum(SEGMENTS)
    middles, ends = spread_mass(lengths, np.full(count, per_m), np.full(count, RADIUS_M))
    ends[-1, 0] += payload_kg
    none = np.zeros(0)
    elements = MovingElements(
        lengths, np.zeros(count), 3, middles, ends, np.zeros((count, 0, 2)), none, none
    )  # fmt: skip
    stiffness = np.zeros((count, STRAINS))
    stiffness[:, :3] = (np.repeat(np.linspace(1.0, numbers[5], 3), PER) * stiff * per_m / lengths)[:, None]
    return MovingRod(elements, stiffness, damping_s)


def posture(rod: MovingRod, discs: Array) -> Array:
    """Bends of each segment for discs ``(3, 3)``, as strains ``(elements, 6)``."""

    def strains(bends: Array) -> Array:
        out = np.zeros((rod.count, STRAINS))
        out[:, :2] = np.repeat(bends.reshape(3, 2) / PER, PER, axis=0)
        return out

    def left(bends: Array) -> Array:
        rod.put(strains(bends))
        return np.concatenate(((rod.poses[PER::PER, :3] - discs).ravel(), 1e-4 * bends))

    return strains(least_squares(left, np.full(6, 0.05), max_nfev=40).x)


def holding(rod: MovingRod, strains: Array) -> Array:
    """Moments that hold a posture against weight and stiffness, ``(elements, 6)``."""
    rod.load(gravity_m_s2=GRAVITY)
    moments = rod.stiffness * strains
    for _ in range(6):
        rod.load(gravity_m_s2=GRAVITY, strains=moments)
        rod.put(strains)
        rod.settle()
        moments = moments + rod.stiffness * (strains - rod.strain)
    return moments


def tips(numbers: Array, release: TrunkRelease) -> Array:
    """Tip of the twin ``(frames, 3)`` [m]."""
    rod = rod_of(numbers, release.payload_kg)
    delay_s, fading_s = numbers[3:5].tolist()
    begin = posture(rod, release.discs[0])
    end = posture(rod, release.discs[-10:].mean(axis=0))
    held, left = holding(rod, begin), holding(rod, end)
    rod.put(begin)
    out = np.empty((len(release.discs), 3))
    for k in range(len(out)):
        out[k] = rod.poses[-1, :3]
        share = float(np.clip((k * PERIOD_S - delay_s) / max(fading_s, 1e-3), 0.0, 1.0))
        rod.load(gravity_m_s2=GRAVITY, strains=held + share * (left - held))
        rod.run(PERIOD_S, PERIOD_S / 2)
    return out


def swing(tip: Array) -> DampedSinusoid | None:
    """The swing of a tip that ends at rest; None where it does not pass its end."""
    about = tip - tip[-10:].mean(axis=0)
    along = about @ (about[0] / np.linalg.norm(about[0]))
    past = int(np.argmax(along < 0.0))
    if past == 0 or past + 30 > len(along):
        return None
    seen = along[past : past + 100]
    at_s = PERIOD_S * np.arange(len(seen))

    def left(x: Array) -> Array:
        rate, ratio = 2.0 * np.pi * x[0], min(max(x[1], 0.01), 0.95)
        return np.asarray(
            seen - x[2] * np.exp(-ratio * rate * at_s) * np.sin(rate * np.sqrt(1 - ratio**2) * at_s + x[3])
        )

    found = least_squares(left, [2.5, 0.3, float(seen.min()) * 2.0, 0.0], x_scale=[1.0, 0.1, 0.02, 0.3])
    return DampedSinusoid(float(found.x[0]), float(found.x[1]))


def report() -> Iterator[str]:
    """The fit, then each release."""
    all_of = releases("decay_200g", 0.2) + releases("decay_demo", 0.0)
    some = all_of[:: max(1, len(all_of) // FITTED)][:FITTED]

    some = [each for each in some if swing(each.discs[:, 2]) is not None]

    def left(numbers: Array) -> Array:
        out = []
        for each in some:
            try:
                twin = tips(numbers, each)
            except ArithmeticError:
                twin = 2.0 * each.discs[:, 2]
            real, found = swing(each.discs[:, 2]), swing(twin) or DampedSinusoid(9.0, 0.9)
            assert real is not None
            rows = len(twin) ** 0.5
            out.append((twin - each.discs[:, 2]).ravel() / TIP_M / rows)
            out.append(np.array([
                np.log(found.frequency_hz / real.frequency_hz) / HZ_SHARE,
                np.log(max(found.ratio, 0.01) / max(real.ratio, 0.01)) / RATIO_SHARE,
            ]))  # fmt: skip
        return np.concatenate(out)

    low, high = [0.005, 0.02, 0.0, 0.0, 0.0, 0.1], [4.0, 5.0, 0.3, 0.3, 0.6, 4.0]
    scale = [0.15, 0.5, 0.06, 0.03, 0.1, 1.0]
    found = least_squares(
        left, scale, bounds=(low, high), x_scale=scale, diff_step=1e-2, max_nfev=25, loss="soft_l1"
    )
    yield "stiffness by mass, mass, damping time, dead time, fading, tip by base: " + " ".join(
        f"{each:.4g}" for each in found.x
    )
    rows = []
    for each in all_of:
        twin = tips(found.x, each)
        pair = swing(each.discs[:, 2]), swing(twin)
        if pair[0] is None or pair[1] is None:
            continue
        off = float(np.sqrt(np.mean(np.sum((twin - each.discs[:, 2]) ** 2, axis=1))))
        kept = not any(each is one for one in some)
        rows.append((*pair[0], *pair[1], off, each.payload_kg, kept))
    for payload_kg in (0.2, 0.0):
        for kept in (False, True):
            of = np.array([row[:5] for row in rows if row[5] == payload_kg and row[6] == kept])
            if len(of):
                real_hz, real, twin_hz, ratio, off = np.median(of, axis=0)
                yield (
                    f"{1e3 * payload_kg:g} g, {len(of)} releases {'kept out' if kept else 'fitted'}: "
                    f"{real_hz:.2f} Hz {real:.2f}; twin {twin_hz:.2f} Hz {ratio:.2f}; tip {1e3 * off:.1f} mm"
                )


if __name__ == "__main__":
    for line in report():
        print(line)  # noqa: T201
