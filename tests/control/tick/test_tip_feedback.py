"""Closed loop on the tip, on simulated plants whose real curvature or modulus is 10 % off the model's."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Timing, VirtualClock
from contid.control.engine.engine import Engine
from contid.control.engine.ports import BusPort
from contid.control.engine.wiring import build_robot_configs, open_buses
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model, build_model
from contid.robot_file.load import LoadedFile, parse_robot_file, with_mock
from contid.targets import Target
from tests.support.fingers import Collector

CONFIGS = Path(__file__).parents[3] / "configs"
RATE_HZ = 200.0


def load(name: str, change: Callable[[dict[str, Any]], None]) -> LoadedFile:
    data = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    change(data)
    return with_mock(parse_robot_file(yaml.safe_dump(data), name))


class Rig:
    """A robot on simulated actuators whose true kinematics are another model's, and its tracker."""

    def __init__(self, loaded: LoadedFile, truth: Model, tracker_hz: float = 50.0, noise_mm: float = 0.0):
        self.seen = Collector(loaded)
        self.clock = VirtualClock()
        self.buses = open_buses(loaded, self.clock)
        ports = {name: BusPort(bus, threaded=False) for name, bus in self.buses.items()}
        self.config = build_robot_configs(loaded, RATE_HZ)[0]
        self.engine = Engine([self.config], ports, RATE_HZ, self.seen, self.clock.now, attended=True)
        self.engine.arm()
        self.truth = truth
        self.every = round(RATE_HZ / tracker_hz)
        self.rng = np.random.default_rng(5)
        self.noise_m = noise_mm / 1e3
        self.tick = 0
        self.tips: list[tuple[float, float, float]] = []
        self.tracking = True

    def tip(self) -> tuple[float, float, float]:
        """Where the plant's tip really is: the true model at the measured actuation."""
        samples = self.engine.exchange.samples
        values = tuple(value for axis in self.config.axes if (value := samples[axis].value) is not None)
        actuation = self.config.transmission.to_actuation(values)
        return self.config.frame.point_in_world(self.truth.forward(actuation).tip_m)

    def run(self, seconds: float, target: Target | None = None) -> None:
        if target is not None:
            self.engine.obey(msg.Rows({self.config.name: target}), self.tick)
        for _ in range(round(seconds * RATE_HZ)):
            self.clock.set(self.tick / RATE_HZ)
            if self.tracking and self.tips and self.tick % self.every == 0:
                shaken = np.array(self.tips[-1]) + self.rng.normal(0, self.noise_m, 3)
                self.engine.obey(msg.Measured(self.config.name, tuple(shaken.tolist())), self.tick)
            now_s = self.tick / RATE_HZ
            self.engine.cycle(Timing(self.tick, 0, now_s))
            self.tick += 1
            if self.engine.exchange.samples:
                self.tips.append(self.tip())

    def close(self) -> None:
        for bus in self.buses.values():
            bus.close()


def finger(feedback: dict[str, Any] | None, curvature_gain: float = 1.1) -> tuple[LoadedFile, Model]:
    def change(data: dict[str, Any]) -> None:
        robot = data["robots"]["finger"]
        robot.pop("correction")
        robot["placeholder"] = []
        if feedback is not None:
            robot["feedback"] = feedback

    def wrong(data: dict[str, Any]) -> None:
        change(data)
        # Another rack spacing is another curvature: k = (L2 - L1) / (w S).
        data["robots"]["finger"]["geometry"]["rack_spacing_mm"] /= curvature_gain
        data["robots"]["finger"]["limits"]["curvature_max_per_mm"] = 0.2

    truth = build_model(load("finger", wrong).file.robots["finger"])
    return load("finger", change), truth


def arm(feedback: dict[str, Any] | None) -> tuple[LoadedFile, Model]:
    def change(data: dict[str, Any]) -> None:
        if feedback is not None:
            data["robots"]["arm"]["feedback"] = feedback

    def wrong(data: dict[str, Any]) -> None:
        for section in data["robots"]["arm"]["geometry"]["sections"]:
            section["modulus_pa"] = [1.1 * b for b in section["modulus_pa"]]

    truth = build_model(load("stiffflop1", wrong).file.robots["arm"])
    return load("stiffflop1", change), truth


CASES = {
    "finger": (finger, (0.030, 0.070, 0.0), (0.045, 0.060, 0.0)),
    "arm": (arm, (0.012, 0.005, 0.055), (-0.008, 0.010, 0.055)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", ["finger", pytest.param("arm", marks=pytest.mark.campaign)])
def test_the_static_error_of_a_wrong_model_is_removed_without_overshoot(case: str) -> None:
    build, first, second = CASES[case]
    errors = {}
    cases: tuple[dict[str, Any] | None, ...] = (None, {})
    for feedback in cases:
        loaded, truth = build(feedback)
        rig = Rig(loaded, truth)
        rig.run(5.0, Target(tip_m=first))
        start = np.mean(rig.tips[-100:], axis=0)
        began = len(rig.tips)
        rig.run(6.0, Target(tip_m=second))
        rig.close()
        # The regulators are noisy: the static error is that of the mean.
        rest = np.mean(rig.tips[-400:], axis=0)
        errors[feedback is not None] = math.dist(rest, second)
        way = np.array(second) - np.array(start)
        along = (np.array(rig.tips[began:]) - np.array(start)) @ way / (way @ way)
        overshoot = along.max() - max(along[-1], 1.0) if feedback is not None else 0.0
        assert overshoot < 0.10, f"overshoot {overshoot:.1%}"
    assert errors[False] > 5e-4, "the plant must be wrong enough to matter"
    # Quantised actuators leave a rest; 95 % of the static error has to go.
    assert errors[True] < 0.05 * errors[False]


def test_without_the_tracker_it_falls_back_to_the_open_loop_within_a_second_and_without_a_jump() -> None:
    loaded, truth = finger({})
    rig = Rig(loaded, truth)
    rig.run(4.0, Target(tip_m=(0.030, 0.070, 0.0)))
    open_loop = rig.config.model.inverse(Target(tip_m=(0.030, 0.070, 0.0)), rig.config.rest).actuation
    before = rig.engine.robots.states[0].command
    assert max(abs(a - b) for a, b in zip(before, open_loop, strict=True)) > 1e-4
    rig.tracking = False
    commands = [before]
    for _ in range(int(RATE_HZ)):
        rig.run(1 / RATE_HZ)
        commands.append(rig.engine.robots.states[0].command)
    rig.close()
    assert commands[-1] == pytest.approx(open_loop, abs=1e-12)
    steps = np.abs(np.diff(np.array(commands), axis=0))
    assert steps.max() <= rig.config.velocity[0] / RATE_HZ
    assert np.abs(np.diff(steps, axis=0)).max() <= rig.config.acceleration[0] / RATE_HZ**2 * (1 + 1e-9)


@pytest.mark.parametrize("tracking", [True, False])
def test_a_robot_that_holds_keeps_its_correction_only_while_tips_are_measured(tracking: bool) -> None:
    loaded, truth = finger({})
    rig = Rig(loaded, truth)
    rig.run(5.0, Target(tip_m=(0.030, 0.070, 0.0)))
    learnt = rig.engine.robots.states[0].correction.error_m
    rig.engine.obey(msg.Hold(), rig.tick)
    rig.tracking = tracking
    rig.run(1.5)
    held = rig.engine.robots.states[0].correction.error_m
    rig.close()
    assert math.hypot(*learnt) > 1e-3
    # Until it stands still it follows what it learnt on the way.
    assert held == (pytest.approx(learnt, abs=1e-4) if tracking else (0.0, 0.0, 0.0))


def test_a_measurement_counts_from_its_capture() -> None:
    loaded, truth = finger({})
    rig = Rig(loaded, truth)
    rig.run(1.0, Target(tip_m=(0.030, 0.070, 0.0)))
    rig.tracking = False
    rig.run(1.0)
    tip = rig.tip()
    rig.engine.obey(msg.Measured(rig.config.name, tip, None, 0.150), rig.tick)
    rig.run(1 / RATE_HZ)
    correction = rig.engine.robots.states[0].correction
    # One that was captured before it is no news.
    rig.engine.obey(msg.Measured(rig.config.name, (0.0, 0.0, 0.0), None, 0.160), rig.tick)
    rig.run(1 / RATE_HZ)
    rig.close()
    assert correction.used_s == pytest.approx((rig.tick - 2) / RATE_HZ - 0.150)
    assert rig.engine.robots.states[0].correction.seen_m == correction.seen_m


def test_noise_of_the_tracker_is_filtered_and_a_wild_measurement_is_bounded() -> None:
    loaded, truth = finger({"limit_mm": 5.0})
    rig = Rig(loaded, truth, noise_mm=0.3)
    rig.run(6.0, Target(tip_m=(0.030, 0.070, 0.0)))
    settled = np.array(rig.tips[-400:])
    assert np.max(settled.std(axis=0)) < 0.15e-3
    rig.tracking = False
    rig.engine.obey(msg.Measured(rig.config.name, (5.0, 5.0, 0.0)), rig.tick)
    rig.run(0.2)
    error = rig.engine.robots.states[0].correction.error_m
    rig.close()
    assert math.hypot(*error) <= 5e-3 + 1e-12


def test_it_is_off_by_default() -> None:
    loaded, truth = finger(None)
    rig = Rig(loaded, truth)
    rig.run(1.5, Target(tip_m=(0.030, 0.070, 0.0)))
    rig.close()
    assert rig.engine.robots.states[0].correction.error_m == (0.0, 0.0, 0.0)


def test_a_mirrored_base_measures_in_the_world() -> None:
    loaded, truth = finger({})
    robot = loaded.file.robots["finger"]
    mirrored = robot.model_copy(
        update={"base": robot.base.model_copy(update={"x_mm": 100.0, "mirror_x": True})}
    )
    loaded = LoadedFile(
        loaded.path,
        loaded.text,
        loaded.file.model_copy(update={"robots": {"finger": mirrored}}),
        loaded.buses,
    )
    rig = Rig(loaded, truth)
    target = BaseFrame.of(mirrored.base).point_in_world((0.030, 0.070, 0.0))
    rig.run(5.0, Target(tip_m=target))
    rig.close()
    assert math.dist(rig.tips[-1], target) < 1e-4
