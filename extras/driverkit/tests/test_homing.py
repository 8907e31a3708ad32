"""Homing by effort on a bus of the kit, in virtual time: sound axes, and random troubles."""

from __future__ import annotations

import math
import os
import random
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import pytest
from pydantic import BaseModel

from contid.control.engine.cycle import VirtualClock
from contid.errors import DeviceError
from contid.hal import AxisOnBus, Reference
from contid_driverkit import EffortStop, PolledBus, Reading, home_by_effort

DEG = math.pi / 180.0
HOMINGS = int(os.environ.get("CONTID_HOMINGS", "40"))
STOP = EffortStop(direction=-1, effort=0.4, speed_deg_s=60.0, lead_deg=4.0, travel_deg=200.0)


class Options(BaseModel):
    """Of an axis."""

    homing: EffortStop | None = None


@dataclass
class Shaft:
    """A servo whose loop is a spring: it turns at what its error drives, above friction; angles in degrees.

    Attributes:
        load: place of the shaft; ``low`` its end stop, ``block`` an obstacle above it.
        slipped: encoder less load.
    """

    load: float = 90.0
    low: float = -30.0
    block: float = -1e9
    slipped: float = 0.0
    frozen: float | None = None
    jammed: bool = False
    reports: bool = True
    goal: float = 0.0
    powered: bool = False
    amps: float = 0.0

    @property
    def seen(self) -> float:
        """What its encoder shows."""
        return self.load + self.slipped if self.frozen is None else self.frozen

    def step(self, dt: float) -> None:
        """Some time; 0.2 A per degree of error, less what the motion takes back."""
        duty = max(-1.0, min(1.0, 0.2 * (self.goal - self.seen))) if self.powered else 0.0
        drive = math.copysign(max(abs(duty) - 0.08, 0.0), duty)
        before = self.load
        if not self.jammed:
            self.load = max(self.load + 300.0 * drive * dt, self.low, min(self.block, before))
        self.amps = abs(duty) - 0.9 * abs(self.load - before) / dt / 300.0


class ShaftBus(PolledBus):
    """One shaft; ``script`` is called with the time since the opening, before every reading."""

    def __init__(self, shaft: Shaft) -> None:
        self.clock, self.shaft, self.script = VirtualClock(1.0), shaft, lambda time_s: None
        self.axis = AxisOnBus("r.a", Options(homing=STOP))
        self.exchange_s = 0.001
        super().__init__("bus", [self.axis], self.clock)

    def connect(self) -> None:
        self._at = self.clock.now()

    def disconnect(self) -> None:
        pass

    def read(self) -> Mapping[str, Reading]:
        shaft = self.shaft
        while self._at < self.clock.now():
            self.script(self._at - 1.0)
            shaft.step(0.002)
            self._at += 0.002
        self.clock.sleep(self.exchange_s)
        effort = shaft.amps if shaft.reports else None
        return {"r.a": Reading(shaft.seen * DEG, shaft.powered, goal=shaft.goal * DEG, effort=effort)}

    def send(self, goals: Mapping[str, float]) -> None:
        self.shaft.goal = goals["r.a"] / DEG

    def power(self, axes: Collection[str], on: bool) -> None:
        self.shaft.powered = on

    def home(self, former: Reference | None = None, report: list[str] | None = None) -> float:
        """The stop that was found [deg]."""
        axis = self.axis if former is None else replace(self.axis, reference=former)
        lines = [] if report is None else report
        (found,) = home_by_effort(self, [axis], ["r.a"], self.clock, lines.append)
        return found.value / DEG


@pytest.mark.parametrize("reports", [True, False])
def test_a_sound_axis_finds_its_stop_and_rests(reports: bool) -> None:
    bus = ShaftBus(Shaft(reports=reports))
    lines: list[str] = []
    assert bus.home(report=lines) == pytest.approx(-30.0, abs=0.2)
    assert "stop at -30" in lines[-1]
    assert not bus.shaft.powered


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"frozen": 90.0}, "dead encoder|encoder is dead"),
        ({"jammed": True}, "jammed shaft or a dead encoder"),
        ({"low": -1e9}, "no stop within"),
        ({"frozen": 90.0, "reports": False}, "jammed shaft or a dead encoder"),
    ],
)
def test_what_is_no_stop_is_named_and_nothing_stays_under_power(
    fault: dict[str, float], message: str
) -> None:
    bus = ShaftBus(Shaft(**fault))  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match=message):
        bus.home()
    assert not bus.shaft.powered


@pytest.mark.parametrize("jammed", [False, True])
def test_an_encoder_that_jitters_ends_the_search(jammed: bool) -> None:
    """By more than what counts as motion, so that it never stands still."""
    bus = ShaftBus(Shaft(jammed=jammed))

    def jitter(time_s: float) -> None:
        bus.shaft.slipped = 0.5 * math.sin(2.0 * math.pi * time_s / 0.03)

    bus.script = jitter
    with pytest.raises(DeviceError, match="no stop within"):
        bus.home()
    assert not bus.shaft.powered
    assert bus.clock.now() < 30.0


def test_exchanges_that_take_long_do_not_slow_the_way_back() -> None:
    """Of 45 degrees in 0.75 s, and 0.8 s to spare; the goal goes on by the time that has passed."""
    bus = ShaftBus(Shaft())
    bus.axis = AxisOnBus("r.a", Options(homing=STOP.model_copy(update={"backoff_deg": 45.0})))
    bus.exchange_s = 0.04
    assert bus.home() == pytest.approx(-30.0, abs=0.5)


def test_a_zero_that_moved_needs_force() -> None:
    with pytest.raises(DeviceError, match=r"its zero moved by .*mm.*--force"):
        ShaftBus(Shaft()).home(Reference(zero_rad=-28.0 * DEG, mm_per_rad=10.0))
    assert ShaftBus(Shaft()).home(Reference(zero_rad=-30.4 * DEG)) == pytest.approx(-30.0, abs=0.2)


def test_the_push_is_bounded_by_the_lead_and_ends_soon() -> None:
    """An encoder that dies at once: duty of 4 degrees of error at most, for less than two seconds."""
    bus = ShaftBus(Shaft(frozen=90.0))
    pushed: list[float] = []

    def note(time_s: float) -> None:
        pushed.append(abs(bus.shaft.goal - 90.0) if bus.shaft.powered else 0.0)

    bus.script = note
    with pytest.raises(DeviceError):
        bus.home()
    assert max(pushed) <= 4.01
    assert sum(each > 0.0 for each in pushed) * 0.002 < 2.0


@pytest.mark.parametrize("seed", range(HOMINGS))
def test_a_disturbed_search_gives_its_stop_or_an_error(seed: int) -> None:
    """The stop in the count of its encoder is the truth: of the moment when it was found the second time."""
    rng = random.Random(seed)
    kind = ("freeze", "jam", "obstacle", "slip")[seed % 4]
    bus = ShaftBus(Shaft(load=rng.uniform(-25.0, 60.0), reports=rng.random() < 0.7))
    shaft, at_s = bus.shaft, rng.uniform(0.0, 4.0)
    until_s = at_s + rng.choice((rng.uniform(0.05, 1.5), 1e9))
    by_deg = rng.choice((-1, 1)) * rng.uniform(1.0, 60.0)
    done: list[str] = []

    def disturb(time_s: float) -> None:
        begins, ends = time_s >= at_s and not done, time_s >= until_s and len(done) == 1
        if begins and kind == "freeze":
            shaft.frozen = shaft.seen
        elif begins and kind == "slip":
            shaft.slipped += by_deg
        if begins or ends:
            shaft.jammed = kind == "jam" and begins
            shaft.block = -1e9
            if kind == "obstacle" and begins:
                shaft.low = max(-30.0, shaft.load - abs(by_deg) % 10.0)
            elif kind == "obstacle":
                shaft.low = -30.0
            if ends:
                shaft.frozen = None
            done.append(kind)

    bus.script = disturb
    truth: list[float] = []

    class Notes(list[str]):
        """Takes the slip of the moment when the stop was found again."""

        def append(self, line: str) -> None:
            truth.append(-30.0 + shaft.slipped)

    # What stays in the way for ever is recognised by the former zero alone.
    former = Reference(zero_rad=-30.0 * DEG) if kind == "obstacle" else None
    try:
        found = bus.home(former, Notes())
    except DeviceError:
        assert not shaft.powered
        return
    assert not shaft.powered
    late = kind == "slip" and abs(found + 30.0) < 1.0  # it slipped behind the second finding
    assert abs(found - truth[-1]) < 1.0 or late
