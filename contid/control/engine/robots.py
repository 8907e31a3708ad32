"""The robots of a run: of each its plan, its state and its tally, and how a change of its state is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Sink
from contid.control.engine.events import FaultLatched, ModeChanged, OrderRefused
from contid.control.tick import state as change
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault, describe
from contid.control.tick.state import Effect, OrderRefusedError, RobotState
from contid.control.tick.statistics import RobotTally
from contid.control.tick.supervisor import MOVING, Mode
from contid.robot_file.base import StopPolicy

#: How a robot obeys: its state after an order given at a time [s].
Order: TypeAlias = Callable[[RobotConfig, RobotState, float], RobotState]

_BEFORE_THE_FIRST_COMMAND = (Mode.OFF, Mode.CONNECTING, Mode.READY, Mode.ARMING)


def stopping(policy: StopPolicy | None, reason: str) -> Order:
    """The order to stop by a policy, or by each robot's own for a reason (``on_end``, ``on_fault``, ...)."""
    return lambda config, state, now_s: change.stop(
        config, state, policy or getattr(config.stops, reason), now_s
    )


class Robots:
    """All robots of a robot file, by their index in it.

    Attributes:
        configs: what is fixed about each.
        states: what changes.
        tallies: what the report will say.
        told: state of each that was told last.
    """

    def __init__(self, configs: Sequence[RobotConfig], sink: Sink) -> None:
        self.configs = tuple(configs)
        self.states = [RobotState() for _ in configs]
        self.tallies = [RobotTally() for _ in configs]
        self._index = {config.name: index for index, config in enumerate(configs)}
        self.told = [Mode.OFF for _ in configs]
        self._sink = sink

    @property
    def moving(self) -> bool:
        """True while any robot may be in motion."""
        return any(state.mode in MOVING or any(state.steps) for state in self.states)

    @property
    def armed(self) -> bool:
        """True when no robot is on its way to its first command any more."""
        return not any(state.mode in _BEFORE_THE_FIRST_COMMAND and state.wanted for state in self.states)

    @property
    def resting(self) -> bool:
        """True when every robot is OFF, or stopped by a fault, and its devices were told so."""
        return all(
            state.mode in (Mode.OFF, Mode.FAULT) and not state.enabled and state.pending is Effect.NONE
            for state in self.states
        )

    def order(self, who: msg.Who, order: Order, now_s: float) -> None:
        """Give an order to robots by name; what is refused becomes an event."""
        for name in self._index if who is None else who:
            index = self._index.get(name)
            if index is None:
                self._refuse(name, f"no robot {name!r}; there are {', '.join(self._index)}")
                continue
            try:
                self.change(index, order, now_s)
            except OrderRefusedError as error:
                # An order to everybody is not refused by those it does not concern.
                if who is not None:
                    self._refuse(name, str(error))

    def change(self, index: int, order: Order, now_s: float) -> None:
        """Change the state of one robot; what goes wrong is that robot's fault, never the end of the others.

        Raises:
            OrderRefusedError: its state does not allow it.
        """
        config, state = self.configs[index], self.states[index]
        try:
            self.states[index] = order(config, state, now_s)
        except OrderRefusedError:
            raise
        except Exception as error:
            self.fail(index, Fault.INTERNAL, f"{type(error).__name__}: {error}", now_s)

    def fail(self, index: int, fault: Fault, message: str, now_s: float) -> None:
        """Latch a fault of one robot."""
        self.states[index] = change.fail(self.configs[index], self.states[index], fault, message, now_s)

    def tell(self, tick: int) -> None:
        """An event for every state, and every fault, that was entered since the last call."""
        for index, state in enumerate(self.states):
            if state.mode is self.told[index]:
                continue
            self.told[index] = state.mode
            name = self.configs[index].name
            if state.mode is Mode.FAULT:
                fault = FaultLatched(
                    robot=name,
                    fault=int(state.fault),
                    name=state.fault.name,
                    message=describe(state.fault, state.message),
                    detail=state.message,
                    tick=tick,
                )
                self._sink.event(fault)
            self._sink.event(ModeChanged(robot=name, mode=state.mode.name, tick=tick))

    def _refuse(self, name: str, message: str) -> None:
        self._sink.event(OrderRefused(robot=name, message=message))
