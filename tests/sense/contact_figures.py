"""Contacts of the simulated arm: delays at many walls, and false alarms in an hour of spirals.

The plant is `tests.sense.observed.Loaded`, with the errors stated there. Every wall and every spiral has its
own arm and calibration, place, speed and payload (0 to 10 g on every second one).

    python -m tests.sense.contact_figures [WALLS] [SPIRAL_MINUTES] [SPIRALS]
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from tests.sense.contact_runs import ONSET_N, push, spiral


def _shown(name: str, values: np.ndarray, unit: str) -> None:
    p5, p50, p95 = np.quantile(values, [0.05, 0.5, 0.95])
    print(f"  {name}: p5 {p5:.3g}, p50 {p50:.3g}, p95 {p95:.3g}, max {values.max():.3g} {unit}")


def walls(pool: ProcessPoolExecutor, count: int) -> None:
    """Delays and directions."""
    pushes = [each for each in pool.map(push, range(count)) if each is not None]
    found = [each for each in pushes if each.found_s == each.found_s]
    early = sum(each.early for each in pushes)
    print(f"{len(pushes)} walls; {len(found)} found within 1 s, {early} contacts before the wall")
    delay = 1e3 * np.array([each.found_s - each.touch_s for each in found])
    onset = 1e3 * np.array(
        [each.found_s - each.onset_s if each.onset_s == each.onset_s else 0.0 for each in found]
    )
    speed = np.array([each.speed_mm_s for each in found])
    _shown("speed of the tip", speed, "mm/s")
    _shown("from the first touch", delay, "ms")
    _shown(f"from a push of {1e3 * ONSET_N:g} mN (0 where it was found before)", onset, "ms")
    print(f"  within 50 ms of that push: {100.0 * (onset <= 50.0).mean():.1f} %")
    for low, high in ((0, 5), (5, 20), (20, 50), (50, 1000)):
        here = (speed >= low) & (speed < high)
        if here.any():
            _shown(f"{here.sum()} at {low} to {high} mm/s, from the first touch", delay[here], "ms")
            _shown("  from the push", onset[here], "ms")
    _shown("push of the wall when found", 1e3 * np.array([each.push_n for each in found]), "mN")
    _shown("force that was found", 1e3 * np.array([each.force_n for each in found]), "mN")
    _shown("depth when found", np.array([each.depth_mm for each in found]), "mm")
    _shown("angle to the normal", np.array([each.angle_deg for each in found]), "deg")


def spirals(pool: ProcessPoolExecutor, minutes: float, count: int) -> None:
    """Contacts that are none."""
    runs = list(pool.map(spiral, range(count), [minutes / count] * count))
    false = sum(len(contacts) for contacts, _, _ in runs)
    largest = sorted((distance for _, distance, _ in runs), reverse=True)
    looked = np.mean([share for _, _, share in runs])
    print(f"{count} spirals, {minutes:g} simulated minutes: {false} false contacts")
    shown = ", ".join(f"{each:.1f}" for each in largest[:5])
    print(f"  looked {100.0 * looked:.1f} % of the time; largest squared distances {shown}")
    for number, (contacts, _, _) in enumerate(runs):
        for at_s, found in contacts:
            print(f"  spiral {number} at {at_s:.2f} s: {found}")


if __name__ == "__main__":
    given = [float(each) for each in sys.argv[1:]]
    how_many, minutes, number = (*given, *(200.0, 60.0, 24.0)[len(given) :])
    with ProcessPoolExecutor(2) as pool:
        walls(pool, int(how_many))
        spirals(pool, minutes, int(number))
