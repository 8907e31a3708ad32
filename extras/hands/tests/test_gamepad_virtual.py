"""Random inputs of a gamepad in virtual time: within limits, and no motion without the dead-man button."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from contid import Sim
from contid.errors import DeviceLostError
from contid.targets import Target
from contid_hands.teleop.gamepad.mapping import default_mapping, read_mapping
from contid_hands.teleop.gamepad.pad import Gamepad
from contid_hands.teleop.gamepad.session import apply
from contid_hands.teleop.jogger import Jogger
from tests.support import pads
from tests.support.pads import ABS_X, ABS_Y, BTN_TL, Recording, recorded
from tests.support.robot_configs import config_of

#: CONTID_JOG_INPUTS=100000 is the long form; the tip gets half of it.
INPUTS = int(os.environ.get("CONTID_JOG_INPUTS", "1300"))
RATE_HZ = 200.0
#: Of the shipped finger: mm/s, mm/s^2, and what the jerk limit adds after a hold at full speed.
VELOCITY, ACCELERATION = 60.0, 1000.0
SETTLE_S = VELOCITY / ACCELERATION + ACCELERATION / 20000.0 + 0.2
TOLERANCE = 1e-6


class Operated:
    """The shipped finger, moved by a gamepad as `GamepadSession` moves it."""

    def __init__(self, sim: Sim, pad: Gamepad, space: str) -> None:
        self._sim, self._pad, self._axes = sim, pad, space == "axes"
        self.state = sim.step({"left_mm": 60.0, "right_mm": 60.0}, ticks=100)["finger"]
        self._inputs = pad.mapping.axes[:2] if self._axes else pad.mapping.tip[:2]
        self._jogger: Jogger | None = None
        self.now_s = 0.0
        self.refused = 0
        self.held = False
        self.moved = 0.0

    def tick(self) -> None:
        """One tick; checks every limit."""
        self.now_s += 1.0 / RATE_HZ
        before = self.state.command
        try:
            self.held = self._pad.poll(self.now_s).held
        except DeviceLostError:
            self.held = False
        if not self.held:
            if self._jogger is not None:
                self._sim.hold()
                self._jogger = None
            self.state = self._sim.step()["finger"]
        else:
            self.state = self._follow()
        self.moved = max(abs(self.state.command - before))
        assert self.moved * RATE_HZ <= VELOCITY * (1.0 + TOLERANCE)
        assert min(self.state.command) >= -TOLERANCE
        assert max(self.state.command) <= 100.0 + TOLERANCE

    def _follow(self):
        names = ("left_mm", "right_mm") if self._axes else ("x_mm", "y_mm")
        if self._jogger is None:
            start = self.state.command if self._axes else self.state.tip[:2]
            bounds = ([0.0, 0.0], [100.0, 100.0]) if self._axes else (None, None)
            self._sim.resume()  # before this tick, whose row replaces the previous target
            self._jogger = Jogger(list(start), *bounds, speed=40.0, max_speed=VELOCITY, hold_s=0.15)
        apply(self._jogger, self._pad, self._inputs, self.now_s)
        state = self._sim.step(dict(zip(names, self._jogger.advance(self.now_s), strict=True)))["finger"]
        if state.refused:
            self.refused += 1
            self._jogger.refuse()
        else:
            self._jogger.accept()
        return state


@contextmanager
def operated(space: str) -> Iterator[tuple[Operated, Recording]]:
    """A finger and the events of the gamepad that moves it."""
    with Sim("finger") as sim, recorded() as (recording, device):
        pad = Gamepad(device, read_mapping(default_mapping("gamepad"), device.has))
        yield Operated(sim, pad, space), recording


def squeeze(recording: Recording, finger: Operated, ticks: int = 2) -> None:
    """Centre the sticks, then press the dead-man button."""
    for code in (ABS_X, ABS_Y, pads.ABS_RX, pads.ABS_RY):
        recording.axis(code, 0)
    recording.button(BTN_TL, 0)
    recording.button(BTN_TL, 1)
    for _ in range(ticks):
        finger.tick()


@pytest.mark.slow
@pytest.mark.parametrize("space", ["axes", "tip"])
def test_random_inputs_stay_within_the_limits_and_nothing_moves_after_the_release(space: str) -> None:
    chooser = random.Random(21)
    wished = INPUTS if space == "axes" else INPUTS // 2  # targets out of reach take milliseconds each
    inputs = releases = motions_after_release = motions = 0
    with operated(space) as (finger, recording):
        while inputs < wished:
            squeeze(recording, finger, ticks=0)
            pressed = True
            for _ in range(chooser.randint(1, 200)):
                inputs += 1
                code = chooser.choice((ABS_X, ABS_Y, pads.ABS_RX, pads.ABS_RY, 2, 16))
                outwards = inputs < 500 and code == ABS_X  # the walk meets a limit
                recording.axis(code, 32767 if outwards else chooser.randint(-40000, 40000))
                if chooser.random() < 0.004:
                    recording.write(pads.DROPPED + pads.event(pads.KEY, BTN_TL, 1) + pads.REPORT)
                if chooser.random() < 0.004:
                    recording.button(BTN_TL, int(pressed := chooser.random() < 0.5))
                for _ in range(chooser.randint(1, 3)):
                    finger.tick()
                    motions += finger.moved > TOLERANCE
                    assert pressed or not finger.held
            releases += 1
            recording.button(BTN_TL, 0)
            finger.tick()
            assert finger.state.mode != "RUN"
            for count in range(round(SETTLE_S * RATE_HZ) + 10):
                recording.axis(ABS_X, chooser.randint(-32768, 32767))
                finger.tick()
                motions_after_release += count >= SETTLE_S * RATE_HZ and finger.moved > TOLERANCE
    assert motions_after_release == 0
    assert motions > wished // 4
    assert releases > 5
    assert space == "axes" or finger.refused > 0


def test_an_unplugged_device_holds_within_one_tick() -> None:
    with operated("axes") as (finger, recording):
        squeeze(recording, finger)
        recording.axis(ABS_X, 32767)
        for _ in range(100):
            finger.tick()
        assert finger.state.mode == "RUN"
        assert finger.moved * RATE_HZ == pytest.approx(40.0, rel=0.05)  # it makes up for a slow begin
        recording.unplug()
        finger.tick()
        assert finger.state.mode == "HOLD"
        for _ in range(round(SETTLE_S * RATE_HZ)):
            finger.tick()
        stood = list(finger.state.command)
        for _ in range(50):
            finger.tick()
        assert list(finger.state.command) == stood


def test_a_robot_at_a_shared_limit_comes_back() -> None:
    """The curvature of the finger limits both axes together, and they are followed at their pace up to it."""
    model = config_of("finger").model
    with operated("axes") as (finger, recording):
        squeeze(recording, finger)
        recording.axis(ABS_X, -32768)
        while not finger.refused:
            finger.tick()
        recording.button(BTN_TL, 0)
        for _ in range(100):
            finger.tick()
        stood = finger.state.command[0]
        command_m = tuple(finger.state.command / 1e3)
        kept_m = model.inverse(Target(actuation=command_m), command_m).actuation
        assert kept_m == pytest.approx(command_m, abs=1e-9)
        squeeze(recording, finger)
        recording.axis(ABS_X, 32767)
        for _ in range(100):
            finger.tick()
        assert finger.state.command[0] > stood + 5.0
