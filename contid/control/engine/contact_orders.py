"""Looks for contacts in every tick, writes their events, and lets robots react by their policy."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

from contid.control.engine.chain_orders import ChainOrders
from contid.control.engine.cycle import Sink
from contid.control.engine.events import ContactBegan
from contid.control.engine.load_watch import LoadWatch
from contid.control.engine.robots import Order, Robots
from contid.control.tick import transitions
from contid.control.tick.contact.tip_contact import TipContact, TipContactFound
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.control.tick.tip_feedback import Measurement
from contid.robot_file.base import ContactPolicy
from contid.targets import Actuation

#: A robot goes back to its command of so long before the measurement that showed a contact.
RETREAT_S: Final = 0.5
#: Oldest measurement that shows one.
_OLDEST_S: Final = 0.6
#: A robot in another mode does not react: it stops already, or does not move.
_REACTING: Final = (Mode.RUN, Mode.APPROACH, Mode.HOLD)


class ContactOrders:
    """The robots that look for contacts.

    Args:
        robots: all of them.
        loads: their estimated loads.
        chains: the closed chains among them.
        sink: of the events.
    """

    def __init__(self, robots: Robots, loads: LoadWatch, chains: ChainOrders, sink: Sink) -> None:
        self._robots = robots
        self._loads = loads
        self._chains = chains
        self._sink = sink
        self._tips = {
            index: TipContact(config.sensing, observer.arm)
            for index, config in enumerate(robots.configs)
            if config.contact is not None
            and config.sensing is not None
            and (observer := loads.observers.get(index)) is not None
        }
        #: Newest commands of the robots that go back, with their times.
        self._ways: dict[int, deque[tuple[float, Actuation]]] = {
            index: deque(maxlen=round((RETREAT_S + _OLDEST_S) / config.period_s))
            for index, config in enumerate(robots.configs)
            if config.contact is ContactPolicy.RETRACT
        }
        #: Where robots that still brake go back to.
        self._retreats: dict[int, Actuation] = {}

    def cancel(self) -> None:
        """An order came: no robot goes back that has not begun to."""
        self._retreats.clear()

    def tick(self, number: int, now_s: float, measured: Mapping[str, Measurement]) -> None:
        """Before the ticks of the robots, after those of the load estimates."""
        for index, goal in list(self._retreats.items()):
            self._go_back(index, goal, now_s)
        for index, way in self._ways.items():
            state = self._robots.states[index]
            if state.command:
                way.append((now_s - self._robots.configs[index].period_s, state.command))
            else:
                way.clear()
        for index, tip in self._tips.items():
            observer = self._loads.observers[index]
            config = self._robots.configs[index]
            found = tip.tick(observer.trace, measured.get(config.name), observer.found)
            if found is not None:
                self._report(index, number, found)
                self._react(index, found.time_s, self._robots.states[index], now_s)

    def _report(self, index: int, number: int, found: TipContactFound) -> None:
        config = self._robots.configs[index]
        assert config.contact is not None
        direction = [round(part, 4) for part in config.frame.vector_in_world(found.direction_in_base)]
        self._sink.event(
            ContactBegan(
                tick=number,
                robot=config.name,
                time_s=found.time_s,
                direction=direction,
                force_n=found.force_n,
                confidence=found.confidence,
                policy=config.contact.value,
                message=_message(direction, found.force_n, config.contact),
            )
        )

    def _react(self, index: int, found_s: float, state: RobotState, now_s: float) -> None:
        config = self._robots.configs[index]
        if config.contact is ContactPolicy.IGNORE or state.mode not in _REACTING:
            return
        if config.contact is ContactPolicy.STOP:
            self._robots.fail(index, Fault.CONTACT, "contact with its tip", now_s)
            return
        moves = any(state.increments)
        self._robots.order((config.name,), transitions.hold, now_s)
        self._chains.stopped((config.name,), now_s)
        # A chain goes back as a whole or not at all.
        if config.contact is ContactPolicy.RETRACT and moves and not self._chains.concerns(config.name):
            self._retreats[index] = self._before(index, found_s)

    def _before(self, index: int, found_s: float) -> Actuation:
        """The command half a second before a time, or the oldest there is."""
        way = self._ways[index]
        return next((command for at_s, command in reversed(way) if at_s <= found_s - RETREAT_S), way[0][1])

    def _go_back(self, index: int, goal: Actuation, now_s: float) -> None:
        """Begin to go back once the robot stands; not where something else happened to it."""
        state = self._robots.states[index]
        held = state.mode is Mode.HOLD and not state.follow and state.goto is None
        if held and any(state.increments):
            return
        del self._retreats[index]
        if held and state.command != goal:
            self._robots.change(index, _retreat_to(goal), now_s)


def _retreat_to(goal: Actuation) -> Order:
    return lambda config, state, now_s: transitions.retreat(config, state, goal, now_s)


def _message(direction: list[float], force_n: float, policy: ContactPolicy) -> str:
    along = ", ".join(f"{part:.2f}" for part in direction)
    return f"contact: force {1e3 * force_n:.1f} mN along ({along}); policy {policy.value}"
