"""Random keys in virtual time: no limit is violated, and nothing moves after the release."""

from __future__ import annotations

import os
import random

import pytest

from contid import Sim
from contid.targets import Target
from contid_hands.teleop.jogger import Jogger
from tests.support.robot_configs import config_of

#: 10^5 inputs take minutes; CONTID_JOG_INPUTS=100000 is the long form.
INPUTS = int(os.environ.get("CONTID_JOG_INPUTS", "2000"))
RATE_HZ = 200.0
#: Of the shipped finger: mm/s, mm/s^2, and what the jerk limit adds after a stop from full speed.
VELOCITY, ACCELERATION = 60.0, 1000.0
SETTLE_S = VELOCITY / ACCELERATION + ACCELERATION / 20000.0 + 0.2
TOLERANCE = 1e-6
#: Beyond a limit that both racks share: rounding [m].
SHARED_M = 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("space", ["axes", "tip"])
def test_random_keys_stay_within_the_limits_and_nothing_moves_after_the_release(space: str) -> None:
    chooser, model = random.Random(7), config_of("finger").model
    with Sim("finger") as sim:
        state = sim.step({"left_mm": 60.0, "right_mm": 60.0}, ticks=100)["finger"]
        axes = space == "axes"
        start = list(state.command) if axes else list(state.tip[:2])
        names = ("left_mm", "right_mm") if axes else ("x_mm", "y_mm")
        bounds = ([0.0, 0.0], [100.0, 100.0]) if axes else (None, None)
        jogger = Jogger(start, *bounds, speed=40.0, max_speed=VELOCITY, hold_s=0.15)
        now_s, before, reference = 0.0, list(state.command), list(start)
        refused = releases = inputs = motions_after_release = 0
        pressed_s = 0.0

        def tick() -> list[float]:
            nonlocal now_s, before, refused
            now_s += 1.0 / RATE_HZ
            state = sim.step(dict(zip(names, jogger.advance(now_s), strict=True)))["finger"]
            if state.refused:
                refused += 1
                jogger.refuse()
            else:
                jogger.accept()
            command = list(state.command)
            for value, last in zip(command, before, strict=True):
                assert -TOLERANCE <= value <= 100.0 + TOLERANCE
                assert abs(value - last) * RATE_HZ <= VELOCITY * (1.0 + TOLERANCE)
            kept_m = model.inverse(Target(actuation=(at_m := tuple(state.command / 1e3))), at_m).actuation
            assert kept_m == pytest.approx(at_m, abs=SHARED_M)
            moved, before = [abs(a - b) for a, b in zip(command, before, strict=True)], command
            return moved

        while inputs < INPUTS:
            for _ in range(chooser.randint(1, 200)):  # a burst of keys
                inputs += 1
                pressed_s = now_s
                outwards = inputs < 900  # the walk meets a limit
                share = 1.0 if outwards else chooser.choice((-1.0, -0.3, 0.4, 1.0))
                jogger.press(1 if outwards else chooser.randrange(2), share, now_s)
                chooser.choice((jogger.faster, jogger.slower, lambda: None, lambda: None))()
                for _ in range(chooser.randint(1, 3)):
                    tick()
            releases += 1
            while now_s - pressed_s < 0.15 + 2.0 / RATE_HZ:
                tick()
            reference = list(jogger.reference)
            for _ in range(round(SETTLE_S * RATE_HZ)):  # the limiter brakes
                tick()
            for _ in range(10):
                motions_after_release += max(tick()) > TOLERANCE
            assert jogger.reference == reference
    assert motions_after_release == 0
    assert releases > 10
    assert (refused > 0) == (space == "tip")


def test_one_press_is_one_step_however_late_the_program_is() -> None:
    for period_s in (0.001, 0.02, 0.7):
        jogger = Jogger([50.0], [0.0], [100.0], speed=20.0, max_speed=60.0, hold_s=0.15)
        jogger.press(0, 1.0, 10.0)
        for count in range(1, round(2.0 / period_s)):
            jogger.advance(10.0 + count * period_s)
        assert jogger.reference == [pytest.approx(53.0)]
    # A press before the first one is over goes on without a gap and without a sum.
    jogger = Jogger([50.0], None, None, speed=20.0, max_speed=60.0, hold_s=0.15)
    for time_s in (0.0, 0.1, 0.2):
        jogger.press(0, 1.0, time_s)
    assert jogger.advance(9.0) == [pytest.approx(57.0)]
    jogger.press(0, 1.0, 9.0)
    jogger.release()
    assert jogger.advance(10.0) == [pytest.approx(57.0)]


def test_a_jogged_wrist_turns_at_its_own_rate() -> None:
    """A press moves a column by speed times its scale."""
    ends = ([0.0, -90.0], [100.0, 45.0])
    jogger = Jogger([60.0, 10.0], *ends, speed=15.0, max_speed=60.0, hold_s=0.2, scales=[1.0, 3.0])
    jogger.press(0, 1.0, 0.0)
    jogger.press(1, -1.0, 0.0)
    assert jogger.advance(0.2) == pytest.approx([60.0 + 15.0 * 0.2, 10.0 - 45.0 * 0.2])
