"""The robots of a run: configuration, state and statistics of each, and the events of its changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, TypeAlias, TypeVar

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Sink
from contid.control.engine.events.robots import FaultLatched, ModeChanged, OrderRefused, RobotOverran
from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.tick import fault_exits, transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault, describe
from contid.control.tick.state import OrderRefusedError, RobotState
from contid.control.tick.statistics import RobotTally
from contid.control.tick.supervisor import MOVING, UNARMED, Mode, stronger
from contid.control.tick.tip_feedback import Measurement
from contid.records import record
from contid.robot_file.base import StopPolicy
from contid.targets import Vec3

#: Returns the state of a robot after an order given at a time [s].
Order: TypeAlias = Callable[[RobotConfig, RobotState, float], RobotState]
T = TypeVar("T")
#: The question of a model that is the tick of its robot; those beside it are counted from 0 in every tick.
IN_TICK: Final = -1
#: Orders that are refused where they apply to no robot.
_GO_ON: Final = (transitions.resume, fault_exits.recover)


@record(frozen=True, slots=True)
class Stopping:
    """The order to stop by a policy, None for each robot's policy for a reason (``on_end``, ...)."""

    policy: StopPolicy | None
    reason: str

    def policy_of(self, config: RobotConfig) -> StopPolicy:
        """That of a robot."""
        found: StopPolicy = self.policy or getattr(config.stops, self.reason)
        return found

    def __call__(self, config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
        """The state that begins to stop."""
        return transitions.stop(config, state, self.policy_of(config), now_s)


class Robots:
    """All robots of a robot file, by their index in it.

    Attributes:
        configs: configuration of each.
        states: state of each.
        tallies: statistics of each.
        reported: mode of each in its newest event.
        costs: of the cycles, with the alarm of a model that takes too long.
        tick: number of the tick that runs, or before which orders are carried out.
        overran: by robot and question of the present tick the error of a model that did not answer; a replay
            puts those of the recording there.
        measured: newest measured tip by name.
        loads: estimated force on the tip and standard deviation of its components by name, world frame [N].
    """

    def __init__(self, configs: Sequence[RobotConfig], sink: Sink, costs: TickCosts) -> None:
        self.configs = tuple(configs)
        self.states = [RobotState() for _ in configs]
        self.tallies = [RobotTally() for _ in configs]
        self.costs = costs
        self.overran: dict[tuple[str, int], UnansweredError] = {}
        self.tick, self._asked = -1, [0] * len(self.configs)
        self._index = {config.name: index for index, config in enumerate(configs)}
        self.reported = [Mode.OFF for _ in configs]
        self.measured: dict[str, Measurement] = {}
        self.loads: dict[str, tuple[Vec3, Vec3]] = {}
        self._sink = sink

    @property
    def moving(self) -> bool:
        """True while any robot may be in motion."""
        return any(state.mode in MOVING or any(state.increments) for state in self.states)

    @property
    def preparing(self) -> bool:
        """True while any robot connects or arms."""
        return any(state.mode in (Mode.CONNECTING, Mode.ARMING) for state in self.states)

    @property
    def armed(self) -> bool:
        """True when every robot that was to be armed has its first command."""
        return not any(state.mode in UNARMED and state.arm_requested for state in self.states)

    @property
    def resting(self) -> bool:
        """True when every robot is OFF or in FAULT, disabled, with no request pending."""
        return all(
            state.mode in (Mode.OFF, Mode.FAULT) and not state.enabled and not state.pending
            for state in self.states
        )

    def order(self, who: msg.RobotNames, order: Order, now_s: float) -> None:
        """Give an order to robots by name; a refusal becomes an event.

        An order to all robots skips those it does not apply to; one to go on that applies to none is
        refused.
        """
        refused: dict[str, str] = {}
        for name in self._index if who is None else who:
            index = self._index.get(name)
            if index is None:
                self._refuse(name, f"no robot {name!r}; there are {', '.join(self._index)}")
                continue
            try:
                self.change(index, order, now_s)
            except OrderRefusedError as error:
                refused[name] = str(error)
        skips = who is None and not (order in _GO_ON and refused.keys() == self._index.keys())
        for name, message in refused.items():
            mode = self.states[self._index[name]].mode
            clears = order is fault_exits.ask_clear and mode is Mode.FAULT
            if not skips or clears or mode is Mode.STOPPING:
                self._refuse(name, message)

    def change(self, index: int, order: Order, now_s: float) -> None:
        """Change the state of one robot; an error becomes a fault of that robot only.

        Raises:
            OrderRefusedError: its state does not allow it.
        """
        config, state = self.configs[index], self.states[index]
        with self.costs.watched:
            after = self.ask(index, now_s, order, config, state, now_s)
        if after is not None:
            self.states[index] = after
        elif isinstance(order, Stopping) and self.states[index].enabled:
            # Its model failed: it stops without it, and rests by the policy.
            failed = self.states[index]
            policy = stronger(order.policy_of(config), failed.policy)
            self.states[index] = replace(failed, policy=policy)

    def ask(self, index: int, now_s: float, question: Callable[..., T], /, *arguments: object) -> T | None:
        """The answer to a question that may need the model of a robot, outside its tick.

        None where the model fails, which is a fault of its robot only.

        Raises:
            OrderRefusedError: the question is an order that the state does not allow.
        """
        number = self._asked[index]
        self._asked[index] = number + 1
        try:
            if self.overran:
                self.raise_unanswered(index, number)
            self.costs.begin(index)
            answer = question(*arguments)
            self.costs.running = -1
            return answer
        except UnansweredError as error:
            self.note_unanswered(index, error, number)
            fault, message = error.fault, str(error)
        except OrderRefusedError:
            self.costs.running = -1
            raise
        except (Exception, SystemExit) as error:
            self.costs.running = -1
            fault, message = Fault.INTERNAL, f"{type(error).__name__}: {error}"
        self.fail(index, fault, message, now_s)
        return None

    def ask_for_stage(
        self, name: str, now_s: float, question: Callable[..., T], /, *arguments: object
    ) -> T | None:
        """As `ask`; by older rules an error was one of all robots of the stage that asks."""
        if self.configs[0].motion_rules < 6:
            return question(*arguments)
        return self.ask(self._index[name], now_s, question, *arguments)

    def begin_tick(self, number: int) -> None:
        """Count the questions of a tick, from the first order before it on."""
        if number != self.tick:
            self.tick, self._asked = number, [0] * len(self.configs)

    def raise_unanswered(self, index: int, question: int = IN_TICK) -> None:
        """Where a replay has unanswered questions: is this one of a robot's model?

        Raises:
            UnansweredError: it was not answered in the run that is replayed.
        """
        if error := self.overran.pop((self.configs[index].name, question), None):
            raise error

    def note_unanswered(self, index: int, error: UnansweredError, question: int = IN_TICK) -> None:
        """Emit that a question was not answered."""
        name, fault = self.configs[index].name, int(error.fault)
        event = RobotOverran(tick=self.tick, robot=name, message=str(error), fault=fault, question=question)
        self._sink.event(event)

    def fail(self, index: int, fault: Fault, message: str, now_s: float) -> None:
        """Latch a fault of one robot."""
        self.states[index] = transitions.fail(self.configs[index], self.states[index], fault, message, now_s)

    def report_changes(self, tick: int) -> None:
        """Emit an event for every mode and every fault entered since the last call."""
        for index, state in enumerate(self.states):
            if state.mode is self.reported[index]:
                continue
            self.reported[index] = state.mode
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
