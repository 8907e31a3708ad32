"""An arm that is not the model: rods by shooting (DOP853) with wrong parameters and hysteresis."""

from dataclasses import replace

import numpy as np
from scipy.optimize import root

from contid.kinematics.cosserat.identified import SectionErrors, scaled_arm
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named
from contid.units import BAR
from tests.oracles.rod_shooting import shoot

#: Wrong by: modulus of the sections, moments, offset and half the loop of a regulator [bar].
MODULI = (1.04, 0.97)
MOMENTS = 0.98
OFFSET_BAR = 0.03
HALF_LOOP_BAR = 0.015
NOISE_M = 3e-4
RATE_HZ = 50.0


def shipped_robot():
    robot = load_named("stiffflop2").file.robots["arm"]
    assert isinstance(robot, Cosserat)
    return robot


def shipped_model():
    return CosseratModel(shipped_robot())


class Plant:
    """The two-section arm, static at every commanded pressure, with weight where it has a density."""

    def __init__(self, seed, density_kg_m3=0.0, link_g=0.0):
        self.rng = np.random.default_rng(seed)
        self.model = shipped_model()
        rod = self.model.setup.rod
        sections = [
            replace(
                s, modulus_pa=tuple(scale * b for b in s.modulus_pa), bending_gain=MOMENTS * s.bending_gain
            )
            for s, scale in zip(rod.sections, MODULI, strict=True)
        ]
        self.rod = replace(rod, sections=tuple(sections))
        down = 9.80665 * np.array(shipped_robot().down_in_base)
        silicone = [density_kg_m3 * 1e-9 * each.area * each.length * down for each in rod.sections]
        links = [1e-3 * link_g * (each.link > 0.0) * down for each in rod.sections]
        self.weights = np.array(silicone), np.array(links)
        masses = [density_kg_m3] * 2 + [link_g * (each.link > 0.0) for each in rod.sections]
        self.near = CosseratModel(scaled_arm(shipped_robot(), SectionErrors.of([0.0] * 4 + masses, 2)))
        self.offset = self.rng.uniform(-OFFSET_BAR, OFFSET_BAR, 6)
        self.pressure = np.zeros(6)  # inside the chambers, without the offset

    def command(self, bar):
        """Regulators follow a command as far as their play allows."""
        self.pressure = np.clip(self.pressure, bar - HALF_LOOP_BAR, bar + HALF_LOOP_BAR)

    def tip_m(self, force_n, start=None):
        """The tip at rest [m]; contid's model, or a moment at the base [N·mm], only starts the search."""
        pressures = self.pressure + self.offset
        force = np.asarray(force_n, float)
        if start is None:
            start = self.near.engine.forward(pressures.tolist(), tuple(force)).base_moment_nmm
        found = root(
            lambda m: shoot(self.rod, pressures, force, m, *self.weights)[1], start, options={"xtol": 1e-8}
        )
        assert found.success
        self.base_moment = found.x
        return shoot(self.rod, pressures, force, found.x, *self.weights)[0] / 1e3

    def creeping(self, force_n, per_decade, ages_s):
        """Tips without noise at ages of the pose [s], shape (n, 3) [m].

        The compliance grows with the logarithm of the age. Between the first and the last the tip goes along
        a line in the compliance.
        """
        grown = 1.0 + per_decade * np.log10(1.0 + np.asarray(ages_s) / 0.1)
        stiff, ends, start = self.rod, [], None
        for part in grown[[0, -1]]:
            softer = [replace(s, modulus_pa=tuple(b / part for b in s.modulus_pa)) for s in stiff.sections]
            self.rod = replace(stiff, sections=tuple(softer))
            ends.append(self.tip_m(force_n, start))
            start = self.base_moment
        self.rod = stiff
        share = (grown - grown[0]) / (grown[-1] - grown[0])
        return ends[0] + share[:, None] * (ends[1] - ends[0])

    def measurements(self, force_n, seconds):
        """Tips as a tracker reports them while the arm rests, shape (n, 3) [m]."""
        count = round(seconds * RATE_HZ)
        return self.tip_m(force_n) + self.rng.normal(0.0, NOISE_M, (count, 3))


def random_pressures(rng):
    """Commands [bar] at which the sections bend and stay short of their limits."""
    return rng.uniform(0.05, 1.2, 6)


def pascal(bar):
    return tuple((np.asarray(bar) * BAR).tolist())
