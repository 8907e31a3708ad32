"""Resting tips of the simulated arm under an unknown payload, with and without its compensation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from contid.control.engine.messages import Rows
from contid.control.engine.virtual import VirtualProcess
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.base import TipFeedback
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, with_mock
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid.robot_file.simulated_body import SimulatedTracker
from contid.targets import Target
from contid_drivers.sim.bus import SimBus
from tests.sense.observed import ERRORS, GRAM_N, Loaded, calibrated, pascal
from tests.sense.plant import shipped_robot

RATE_HZ = 200.0
PAYLOAD_AT_S, HIDDEN_AT_S, END_S = 3.0, 9.0, 12.0
#: The tip is the mean of so many instants of the second before the tracker is hidden.
INSTANTS = 10
NO_LOAD = Target(tip_m=(0.0, 0.0, 0.0))


class Silent:
    """A sink of nothing."""

    def write(self, values):
        pass

    def event(self, event):
        pass


@dataclass(frozen=True)
class Resting:
    """One run towards one tip.

    Attributes:
        empty_m, loaded_m: tip before the payload and at rest under it, by the plant, shape ``(3,)``.
        step_bar: greatest change of a commanded pressure in one tick after the tracker was lost.
    """

    empty_m: np.ndarray
    loaded_m: np.ndarray
    step_bar: float


def arm_of(seed, poses=30):
    """An arm with its own regulators, calibrated, and the generator of its targets."""
    rng = np.random.default_rng(seed)
    sim = {"sim": SimulatedArm(errors=ERRORS.model_copy(update={"seed": seed}))}
    robot = calibrated(Loaded(shipped_robot().model_copy(update=sim)), rng, poses)
    return robot.model_copy(update=sim), rng


def reached_tip(robot, rng, grams=10.0):
    """A tip that the plant has at some pressures under the payload, and the model with and without it."""
    model = CosseratModel(shipped_robot())
    body = Loaded(robot)
    while True:
        body.force = (0.0, 0.0, 0.0)
        body.follow([0.0] * 6)
        body.tip_in_world_m(0.0)
        body.force = (0.0, 0.0, grams * GRAM_N)
        body.follow(pascal(rng.uniform(0.15, 1.1, 6)))
        tip = body.tip_in_world_m(0.0)
        loads = ((0.0, 0.0, 0.0), body.force)
        answers = [model.inverse(replace(NO_LOAD, tip_m=tip, load_n=load), (0.0,) * 6) for load in loads]
        if not body.lost and all(answer.converged for answer in answers):
            return tip


def resting(robot: Cosserat, tip, *, grams=10.0, estimated=False, feedback=False) -> Resting:
    """Hold a tip in virtual time; a payload comes, then the tracker is lost."""
    tracker = SimulatedTracker(hidden_s=((HIDDEN_AT_S, END_S + 1.0),))
    assert robot.sim is not None
    sim = SimulatedArm(errors=robot.sim.errors, payload_g=grams, payload_at_s=PAYLOAD_AT_S, tracker=tracker)
    loaded = with_mock(load_named("stiffflop2"))
    shipped = loaded.file.robots["arm"]
    loaded.file.robots["arm"] = shipped.model_copy(
        update={
            "sense": robot.sense,
            "sim": sim,
            "load": "estimated" if estimated else "known",
            "feedback": TipFeedback() if feedback else None,
        }
    )
    process = VirtualProcess(loaded, RATE_HZ, Silent())
    (bus,) = process.buses.values()
    assert isinstance(bus, SimBus)
    (arm,) = bus.arms
    process.engine.arm()
    empty, under, steps = np.zeros(3), [], [0.0]
    while process.tick < END_S * RATE_HZ:
        process.begin()
        t_s, before = process.tick / RATE_HZ, process.engine.robots.states[0].command
        if process.engine.robots.armed:
            process.engine.obey(Rows({"arm": replace(NO_LOAD, tip_m=tip)}), process.tick)
        process.turn()
        if process.tick == round((PAYLOAD_AT_S - 0.1) * RATE_HZ):
            empty = np.array(arm.body.tip_in_world_m(t_s))
        if HIDDEN_AT_S - 1.0 <= t_s < HIDDEN_AT_S and process.tick % round(RATE_HZ / INSTANTS) == 0:
            under.append(arm.body.tip_in_world_m(t_s))
        if t_s > HIDDEN_AT_S:
            after = process.engine.robots.states[0].command
            steps.append(max(abs(a - b) for a, b in zip(after, before, strict=True)) / 1e5)
    process.close()
    return Resting(empty, np.mean(under, axis=0), max(steps))
