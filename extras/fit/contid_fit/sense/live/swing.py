"""How far a body may swing about its equilibria: what `load_observer` and `tip_contact` allow a measured tip.

A command moves the equilibrium y, and the body follows as oscillators do whose base moves,

    d'' + 2 z w d' + w^2 d = -y'',      d = tip - y,

for the frequencies w that its first modes have over the workspace, with and without a load. How a swing is
placed in time depends on the frequency to a few per cent; how large it is does not, so that only the largest
amplitude over these frequencies is taken, as a standard deviation of the measured tip.

Units: mm, bar, s. A pure function of its inputs.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.cosserat import Cosserat

#: Oscillators between the least and the greatest frequency.
_BANK: Final = 6
#: Poses over which frequencies are looked for.
_POSES: Final = 12
#: Factor on amplitudes: the second modes, and what the older residuals of a pattern keep of a larger swing.
_FACTOR: Final = 1.5


class BodySwing:
    """The amplitude of one arm's swing.

    Args:
        frequencies_hz: least and greatest undamped frequency of the first modes.
        damping_s: time of Kelvin and Voigt; the damping ratio of a frequency f is pi f times it.
        noise_mm: standard deviation of a measured tip; as much of a swing is not seen.

    Attributes:
        amplitude_mm: after the newest measurement; 0 for a body at rest.
    """

    def __init__(self, frequencies_hz: tuple[float, float], damping_s: float, noise_mm: float) -> None:
        low, high = frequencies_hz
        rate = 2.0 * math.pi * np.geomspace(low, high, _BANK)
        ratio = np.minimum(0.5 * rate * damping_s, 0.95)
        self._decay, self._turning = ratio * rate, rate * np.sqrt(1.0 - ratio**2)
        self._noise_mm = noise_mm
        #: d + i (d' + decay d) / turning of every oscillator and component.
        self._state: Array = np.zeros((_BANK, 3), dtype=np.complex128)
        self._last: tuple[float, Array] | None = None
        self.amplitude_mm = 0.0

    def go_on_from(self, other: BodySwing) -> None:
        """Take the swing of another object for the same arm, which saw measurements that this one did not."""
        self._state, self._last, self.amplitude_mm = other._state, other._last, other.amplitude_mm

    def to(self, time_s: float, pressures_bar: Array, by_pressure: Array) -> float:
        """The amplitude at a measurement [mm].

        Args:
            time_s: its capture; one that is not later than the last adds nothing.
            pressures_bar: of the axes then.
            by_pressure: derivative of the tip by them [mm/bar], ``(3, axes)``.
        """
        if self._last is not None:
            before_s, before = self._last
            if time_s <= before_s:
                return self.amplitude_mm
            # The equilibrium moves at once half-way between two measurements: a push on the distance.
            moved = by_pressure @ (pressures_bar - before)
            half = np.exp(-(self._decay + 1j * self._turning) * 0.5 * (time_s - before_s))[:, None]
            state = self._state * half
            # The tip stays at first: d falls by the motion, and the damping gives it twice the decay as rate.
            state = state - moved * (1.0 - 1j * (self._decay / self._turning)[:, None])
            self._state = state * half
        self._last = (time_s, pressures_bar)
        largest = float(np.linalg.norm(np.abs(self._state), axis=1).max())
        self.amplitude_mm = max(0.0, _FACTOR * largest - self._noise_mm)
        return self.amplitude_mm


class NoSwing(BodySwing):
    """Of an arm whose file has no ``dynamics``: it is at rest at every instant."""

    def __init__(self) -> None:
        super().__init__((1.0, 2.0), 0.0, 0.0)

    def to(self, time_s: float, pressures_bar: Array, by_pressure: Array) -> float:
        """No amplitude."""
        return 0.0


def swing_of(robot: Cosserat) -> BodySwing:
    """The swing of an arm with ``sense``: frequencies over its workspace, without and with a load.

    Raises:
        ContidError: no equilibrium was found.
    """
    from contid_dynamics.report import range_over_poses

    if robot.dynamics is None or robot.sense is None or not robot.sense.load.swings:
        return NoSwing()
    found = []
    for payload_g in (0.0, robot.sense.load.expected_g):
        ranges = range_over_poses(robot, _POSES, 2, payload_g, undamped=True)
        found += [each for pair in ranges for each in pair if math.isfinite(each)]
    if not found:
        raise ContidError("dynamics: no pose of the arm has an equilibrium; `contid modes` shows one")
    return BodySwing((min(found), max(found)), 1e-3 * robot.dynamics.damping_ms, robot.sense.load.noise_mm)
