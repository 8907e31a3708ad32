"""Orders of the daemon carried out between two ticks, on robots, targets and chains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from contid.control.engine import messages as msg
from contid.control.engine.cycle import Sink
from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import EffortLimited, MarkReached, OrderRefused
from contid.control.engine.exchange import Exchange
from contid.control.engine.order_events import order_event, rows_event
from contid.control.engine.robots import Order, Robots, Stopping
from contid.control.engine.stages import ArmsTogether, TickStage, with_method
from contid.control.engine.target_selector import TargetSelector
from contid.control.tick import fault_exits, transitions
from contid.control.tick.config import RobotConfig
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import stronger
from contid.control.tick.tip_feedback import Measurement
from contid.targets import Target


class NumberedRefusals:
    """A sink before another one, which gives a refusal the number of the order that it answers.

    What robots refuse by themselves, beside the orders, has none.

    Attributes:
        order: number of the order that is carried out now, 0 for none.
    """

    def __init__(self, sink: Sink) -> None:
        self.order = 0
        self._sink = sink

    def write(self, values: list[float]) -> None:
        """See `Sink.write`."""
        self._sink.write(values)

    def event(self, event: RunEvent) -> None:
        """See `Sink.event`."""
        if self.order and isinstance(event, OrderRefused):
            event = replace(event, answers=self.order)
        self._sink.event(event)


class OrderHandler:
    """Carries out `contid.control.engine.messages`.

    Attributes:
        number: of the order that the next message belongs to, 0 for none (`messages.Mark`).
    """

    def __init__(
        self,
        robots: Robots,
        selector: TargetSelector,
        exchange: Exchange,
        chains: ArmsTogether,
        stages: Sequence[TickStage],
        sink: Sink,
        stage_failed: Callable[[TickStage, Exception, float], None],
    ) -> None:
        """``stage_failed`` is called with a stage, its error and the time."""
        self.number = 0
        self._robots = robots
        self._selector = selector
        self._exchange = exchange
        self._chains, self._has_chains = chains, chains.has_chains
        self._stage_failed = stage_failed
        self._changing_gotos = with_method(stages, "goto")
        self._cancelled = with_method(stages, "cancel")
        self._sink = sink

    def obey(self, message: object, tick_number: int, step: int, now_s: float, skipped_s: float) -> None:
        """Carry out a message before a step of the robots; a refusal becomes an event.

        Args:
            message: of `contid.control.engine.messages`.
            tick_number: of the tick that comes.
            step: its number among the ticks that ran.
            now_s: the time of the robots then.
            skipped_s: the time of the ticks that were skipped so far.
        """
        selector = self._selector
        if isinstance(message, msg.Rows):
            self._sink.event(rows_event(message, tick_number))
            if self._has_chains:
                self._chains.begin_gotos(now_s)
            if not selector.finishing:  # nothing may delay the end of a run
                selector.rows(message.targets, now_s, skipped_s)
            return
        if isinstance(message, msg.Go) and not selector.at_start:
            self._sink.event(OrderRefused(message=msg.NOT_AT_START))
            message = msg.Hold()
        if (order := order_event(message, tick_number)) is not None:
            self._sink.event(order)
        if self._has_chains and not isinstance(message, msg.Goto):
            self._chains.begin_gotos(now_s)
        # A client that gives orders may give more: the run then waits even if every robot is in FAULT.
        selector.attended = selector.attended or not isinstance(message, msg.Measured | msg.EndOfRows)
        moving = msg.Resume | msg.Follow | msg.Recover | msg.Goto | msg.Play | msg.Begin
        if selector.finishing and isinstance(message, moving):
            robot = message.robot if isinstance(message, msg.Goto) else ""
            self._sink.event(OrderRefused(robot=robot, message="the run is ending; motions are refused"))
            return
        self._carry_out(message, tick_number, step, now_s)

    def _carry_out(self, message: object, tick_number: int, step: int, now_s: float) -> None:
        """Apply a message to robots, selector and chains."""
        robots, selector, chains = self._robots, self._selector, self._chains
        if not isinstance(message, msg.Measured | msg.EndOfRows | msg.Mark):
            for stage in self._cancelled:
                try:
                    stage.cancel()
                except Exception as error:  # an error in a stage must not stop an order to stop
                    self._stage_failed(stage, error, now_s)
        match message:
            case msg.Measured(robot, tip_in_world, direction, age_s):
                robots.measured[robot] = Measurement(tip_in_world, now_s - age_s, direction)
            case msg.EndOfRows():
                selector.end_of_rows()
            case msg.Play(trajectory, waits):
                selector.play(trajectory, now_s, waits)
            case msg.Go():
                selector.go()
            case msg.Begin():
                selector.begin_rows(now_s)
            case msg.Mark(number):
                self.number = number + 1 if number % 2 else 0
                self._sink.event(MarkReached(number=number, tick=tick_number))
            case msg.Goto(robot, target, None) if chains.concerns(robot):
                chains.keep_goto(robot, target)
            case msg.Goto(robot, target, force_n):
                robots.order((robot,), self._goto(target, force_n), now_s)
            case msg.Hold(who):
                selector.pause(who, step)
                robots.order(who, transitions.hold, now_s)
                chains.stopped(who, now_s)
            case msg.Resume(who):
                selector.resume(who)
                robots.order(who, transitions.resume, now_s)
            case msg.Follow(who):
                selector.resume(who)
                robots.order(who, transitions.follow, now_s)
            case msg.Stop(who, policy, reason):
                selector.pause(who, step)
                stopping = Stopping(policy, reason)
                robots.order(who, stopping, now_s)
                self._report_stronger(who, stopping)
                chains.stopped(who, now_s)
            case msg.Estop(who):
                selector.pause(who, step)
                robots.order(who, transitions.estop, now_s)
                chains.stopped(who, now_s)
            case msg.Grip(share, who):
                self._limit_effort(who, share, tick_number)
            case msg.ClearFault(who):
                robots.order(who, fault_exits.ask_clear, now_s)
            case msg.Recover(who):
                robots.order(who, fault_exits.recover, now_s)
            case msg.Finish(policy, reason):
                selector.finish(policy, reason, now_s)

    def _report_stronger(self, who: msg.RobotNames, order: Stopping) -> None:
        """Emit of which robots a stop goes on that leaves less power than the one just ordered."""
        for index, (config, state) in enumerate(zip(self._robots.configs, self._robots.states, strict=True)):
            if who is not None and config.name not in who:
                continue
            asked, owed = order.policy_of(config), self._exchange.requests.owed(index)
            policy, how = state.policy, "goes on"
            if owed is not None and stronger(owed, policy) is not policy:
                policy, how = owed, "is sent to its devices when their bus is back"
            if policy is not None and stronger(asked, policy) is not asked:
                message = (
                    f"{config.name}: its stop by {policy.value} {how}; {asked.value} would leave more power"
                )
                event = OrderRefused(robot=config.name, message=message, stronger=policy.value)
                self._sink.event(event)

    def _goto(self, target: Target, force_n: float | None) -> Order:
        """The order to go to a target, as the stages change it."""

        def order(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
            goal = target
            for stage in self._changing_gotos:
                goal = stage.goto(config.name, goal)
            return transitions.goto(config, state, goal, now_s, force_n)

        return order

    def _limit_effort(self, who: msg.RobotNames, share: float, tick_number: int) -> None:
        """Limit the effort of robots; one named without an axis for it is a refusal."""
        limited = self._exchange.limit_effort(who, share)
        for name, done in limited.items():
            if done:
                self._sink.event(EffortLimited(tick=tick_number, robot=name, share=share))
            elif who is not None or not any(limited.values()):
                message = f"{name}: none of its axes is in a mode that limits its effort"
                self._sink.event(OrderRefused(robot=name, message=message))
