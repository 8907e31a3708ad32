"""The hand, its left finger beside an elastic object: runs in virtual time, sampled in every tick."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from contid.control.engine import messages as msg
from contid.control.engine.events import RunEvent
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick.state import RobotState
from contid.robot_file.load import LoadedFile, load_named, load_robot_file, parse_robot_file, with_mock
from contid.robot_file.rack_finger import CurrentSense, RackFinger
from contid.targets import Target
from contid_drivers.sim.bus import SimBus
from contid_dynamics.finger_body import FingerBody

RATE_HZ: Final = 200.0
SENSE: Final = "{contact: hold, usual_ma: 200, contact_ma: 100, nm_per_a: 0.354}"
#: Before the object, and behind its surface.
BEFORE: Final = Target(tip_m=(0.030, 0.075, 0.0))
BEHIND: Final = Target(tip_m=(0.055, 0.075, 0.0))
FACE_MM: Final = 40.0
#: Ticks of the orders in `closing`.
AT_BEFORE, AT_CLOSE = 20, 100


def hand_text(stiffness_n_per_mm: float | None = 1.0, *, sense: str = SENSE, until_s: float = 0.0) -> str:
    """The shipped hand; its left finger senses currents and meets an object at x = 40 mm."""
    found = ""
    if stiffness_n_per_mm is not None:
        found = f"point_mm: [{FACE_MM}, 0, 0], normal: [-1, 0, 0], stiffness_n_per_mm: {stiffness_n_per_mm}"
        found = f"object: {{{found}{f', until_s: {until_s}' if until_s else ''}}}"
    rest = "    rest_mm: [60, 60]\n"
    lines = f"    sense: {sense}\n" if sense else ""
    text: str = load_named("hand").text.replace(rest, f"{rest}{lines}    sim: {{{found}}}\n", 1)
    return text


def hand(stiffness_n_per_mm: float | None = 1.0, *, sense: str = SENSE, until_s: float = 0.0) -> LoadedFile:
    """The simulated hand of `hand_text`."""
    return with_mock(
        parse_robot_file(hand_text(stiffness_n_per_mm, sense=sense, until_s=until_s), "hand.yaml")
    )


def sense_of(path: Path) -> CurrentSense:
    """The ``sense`` of the left finger of a file."""
    finger = load_robot_file(path).file.robots["left"]
    assert isinstance(finger, RackFinger)
    assert finger.sense is not None
    return finger.sense


@dataclass
class Run:
    """What a run left behind; one row per tick.

    Attributes:
        events: of the run.
        states: of the left finger.
        push_n: force of the object on its tip.
    """

    events: list[RunEvent] = field(default_factory=list)
    states: list[RobotState] = field(default_factory=list)
    push_n: list[float] = field(default_factory=list)

    def write(self, values: list[float]) -> None:
        """See `contid.control.engine.cycle.Sink`."""

    def event(self, event: RunEvent) -> None:
        """See `contid.control.engine.cycle.Sink`."""
        self.events.append(event)

    @property
    def commands(self) -> np.ndarray:
        """Rack lengths [m], from the first one on."""
        return np.array([state.command for state in self.states if state.command])


def closing(
    goal_n: float, more: Mapping[int, Sequence[msg.Message]] | None = None
) -> Mapping[int, Sequence[msg.Message]]:
    """Orders: arm, go before the object, close on it."""
    return {
        10: [msg.Resume()],
        AT_BEFORE: [msg.Goto("left", BEFORE)],
        AT_CLOSE: [msg.Goto("left", BEHIND, goal_n)],
        **(more or {}),
    }


def run(
    loaded: LoadedFile,
    orders: Mapping[int, Sequence[msg.Message]],
    seconds: float = 5.0,
    friction_in_contact: float = 1.0,
) -> Run:
    """Run in virtual time; from the touch on, friction is another one by a factor."""
    found = Run()
    process = VirtualProcess(loaded, RATE_HZ, found, attended=True)
    bus = process.buses["servos"]
    assert isinstance(bus, SimBus)
    (body,) = bus.fingers
    assert isinstance(body, FingerBody)
    free_a = body.friction_a
    process.engine.connect()
    for tick in range(round(seconds * RATE_HZ)):
        process.begin()
        for message in orders.get(tick, ()):
            process.engine.obey(message, process.tick)
        process.turn()
        if body.push_n > 0.0:
            body.friction_a = free_a * friction_in_contact
        found.states.append(process.engine.robots.states[0])
        found.push_n.append(body.push_n)
    process.close()
    return found
