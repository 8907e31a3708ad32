"""Looks for contacts in every tick, writes their events, and lets robots react by their policy."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from contid.control.engine.cycle import Sink, Timing
from contid.control.engine.events.robots import ContactBegan, OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.robots import Order, Robots
from contid.control.engine.stages import ArmsTogether, ReactsToContacts, Targets
from contid.control.tick import transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.robot_file.base import ContactPolicy
from contid.targets import Actuation, Target
from contid_contact.current_contact import CurrentContact

#: A robot goes back to the command that it had this long before the measurement that showed a contact.
RETREAT_S: Final = 0.5
#: Age of the oldest measurement that can show a contact [s].
_OLDEST_S: Final = 0.6
#: Step of an axis of the difference by which the direction of its motion of the tip is computed [m].
_STEP: Final = 1e-5
#: A robot in another mode does not react: it stops already, or does not move.
_REACTING: Final = (Mode.RUN, Mode.APPROACH, Mode.HOLD)


class ContactStage(ReactsToContacts):
    """The robots that look for contacts: their currents, and the reactions to every contact.

    Args:
        robots: all of them.
        exchange: with their devices.
        chains: the closed chains among them.
        sink: of the events.
    """

    def __init__(self, robots: Robots, exchange: Exchange, chains: ArmsTogether, sink: Sink) -> None:
        self.robots = [index for index, config in enumerate(robots.configs) if config.contact is not None]
        self._robots = robots
        self._exchange = exchange
        self._chains = chains
        self._sink = sink
        self._currents = {
            index: CurrentContact(len(config.axes), config.usual_a, config.contact_a, config.period_s)
            for index, config in enumerate(robots.configs)
            if config.contact_a
        }
        #: Robots whose devices report no current; each is refused once.
        self._silent: set[int] = set()
        #: Newest commands of the robots with policy ``retract``, with their times.
        self._ways: dict[int, deque[tuple[float, Actuation]]] = {
            index: deque(maxlen=round((RETREAT_S + _OLDEST_S) / config.period_s))
            for index, config in enumerate(robots.configs)
            if config.contact is ContactPolicy.RETRACT
        }
        #: Commands to which robots that still brake will go back.
        self._retreats: dict[int, Actuation] = {}
        self.going_back: dict[int, Target | None] = {}

    def cancel(self) -> None:
        """Cancel the ways back that have not begun; called when an order came."""
        self._retreats.clear()

    def before(self, targets: Targets, timing: Timing, now_s: float) -> Targets:
        """See `TickStage.before`: robots that react go back, currents are looked at."""
        for index, target in list(self.going_back.items()):
            ended = target is None or self._robots.states[index].goto is not target
            if ended and index not in self._retreats:
                del self.going_back[index]
        for index, goal in list(self._retreats.items()):
            self._go_back(index, goal, now_s)
        for index, way in self._ways.items():
            state = self._robots.states[index]
            if state.command:
                way.append((now_s - self._robots.configs[index].period_s, state.command))
            else:
                way.clear()
        for index, currents in self._currents.items():
            self._tick_currents(index, currents, timing.tick, now_s)
        return targets

    def _tick_currents(self, index: int, currents: CurrentContact, number: int, now_s: float) -> None:
        config, state = self._robots.configs[index], self._robots.states[index]
        samples = self._exchange.samples_of(config)
        if not state.enabled or not samples or not state.command:
            return
        if index not in self._silent and all(each.valid and each.effort is None for each in samples):
            self._silent.add(index)
            message = f"{config.name}: its devices report no current, so sense.contact finds nothing"
            self._sink.event(OrderRefused(robot=config.name, message=message))
        found = currents.tick(samples)
        if found is None:
            return
        ask = self._robots.ask_for_stage
        direction = ask(config.name, now_s, _against, config, state, samples, found.axes) or []
        assert config.contact is not None
        # A tip that closes on an object is meant to meet it.
        policy = config.contact if state.squeeze is None else ContactPolicy.IGNORE
        axis = ", ".join(config.axis_names[each] for each in found.axes)
        excess_ma = 1e3 * found.excess_a
        what = f"contact of {axis}: {excess_ma:.0f} mA above the usual current"
        self._sink.event(
            ContactBegan(
                tick=number,
                robot=config.name,
                axis=axis,
                time_s=now_s,
                direction=direction,
                force_n=0.0,
                excess_ma=excess_ma,
                confidence=found.confidence,
                policy=policy.value,
                message=f"{what}; policy {policy.value}",
            )
        )
        if policy is not ContactPolicy.IGNORE:
            self.react(index, now_s, what, now_s)

    def react(self, index: int, found_s: float, what: str, now_s: float) -> None:
        """See `contid.control.engine.stages.React`."""
        config, state = self._robots.configs[index], self._robots.states[index]
        if config.contact is ContactPolicy.IGNORE or state.mode not in _REACTING:
            return
        if config.contact is ContactPolicy.STOP:
            self._robots.fail(index, Fault.CONTACT, what, now_s)
            return
        moves = any(state.increments)
        self._robots.order((config.name,), transitions.hold, now_s)
        self._chains.stopped((config.name,), now_s)
        # A chain goes back as a whole or not at all.
        if config.contact is ContactPolicy.RETRACT and moves and not self._chains.concerns(config.name):
            self._retreats[index] = self._before(index, found_s)
            self.going_back[index] = None

    def _before(self, index: int, found_s: float) -> Actuation:
        """The command `RETREAT_S` before a time, or the oldest one kept."""
        way = self._ways[index]
        return next((command for at_s, command in reversed(way) if at_s <= found_s - RETREAT_S), way[0][1])

    def _go_back(self, index: int, goal: Actuation, now_s: float) -> None:
        """Begin to go back once the robot stands, unless it has left HOLD or follows another target."""
        state = self._robots.states[index]
        held = state.mode is Mode.HOLD and not state.follow and state.goto is None
        if held and any(state.increments):
            return
        del self._retreats[index]
        if held and state.command != goal:
            self._robots.change(index, _retreat_to(goal), now_s)
            self.going_back[index] = self._robots.states[index].goto


def _against(
    config: RobotConfig, state: RobotState, samples: Sequence[Sample], axes: Sequence[int]
) -> list[float]:
    """Direction of the force on the tip that keeps axes from their commands; [] where they move no tip."""
    values = [sample.value for sample in samples]
    own = [axis for axis in axes if axis < len(config.axes) - config.extra_axes]
    if not own or None in values:
        return []
    measured = config.transmission.to_actuation(tuple([value or 0.0 for value in values]))
    moved = list(state.command)
    for axis in own:
        moved[axis] += math.copysign(_STEP, state.command[axis] - measured[axis])
    here, there = (config.model.forward(tuple(each)).tip_m for each in (state.command, moved))
    x, y, z = (a - b for a, b in zip(here, there, strict=True))
    size = math.hypot(x, y, z)
    if not size > 0.0:
        return []
    return [round(part / size, 4) for part in config.frame.vector_in_world((x, y, z))]


def _retreat_to(goal: Actuation) -> Order:
    return lambda config, state, now_s: transitions.retreat(config, state, goal, now_s)
