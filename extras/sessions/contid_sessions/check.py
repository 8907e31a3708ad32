"""Checks a recorded session against the rules of motion, independently of the code that moved the robots.

Only records, events and the limits of the robot file are used, neither the limiter nor the tick.

| rule | what must hold |
|---|---|
| time | ticks and deadlines grow; every missing tick is counted as skipped or lost |
| position | a command is inside the limits of its axis; from outside it never goes further out |
| velocity, acceleration | differences of consecutive commands, from standstill at the first |
| jerk | third differences within one planned motion, without RUN and the end of the shortest stop |
| jerk on a slowed path | one and a half times that, while a body that lags slows paths |
| arming | the first command is at the measured position |
| follow | a measured axis follows its commands within the tolerance of the robot file |
| estop | no command in the tick after an emergency stop, and OFF (a fault stays) |
| fault | every fault has its event; FAULT is left after `clear_fault` or `recover` only |
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import RecorderOverrun
from contid.control.engine.events.robots import FaultLatched, OrderGiven, PathSlowed
from contid.control.engine.messages import ClearFault, Grip, Measured, Recover
from contid.control.engine.tick_layout import RobotRecord, TickRecord
from contid.control.engine.wiring import build_robot_configs
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.errors import SessionError
from contid.session.read import Session
from contid_sessions.check_follow import FollowCheck

#: Rounding of float64 in commands, as a share of their largest value.
_ROUNDING: Final = 1e-9
#: Share of the jerk that a path has whose pace changes: its own, and half for the pace.
_SLOWED: Final = 1.5
#: The profiles of planned motions come from another library: rounding of its times.
_JERK_ROUNDING: Final = 1e-3
#: Modes in which a robot may stop in the shortest way (`contid.trajectory.straight_stop`).
_STOPS: Final = frozenset({Mode.APPROACH, Mode.HOLD, Mode.STOPPING, Mode.FAULT})
#: Faults by which a run ended a motion that the body did not follow.
_OF_THE_BODY: Final = frozenset({Fault.DOES_NOT_FOLLOW, Fault.MOVES_UNASKED, Fault.IMPLAUSIBLE_SAMPLE})
#: First command and measurement may differ by the resolution of a device: this share of the travel.
ARMING_SHARE: Final = 0.005


@dataclass(frozen=True, slots=True)
class Violation:
    """A rule that a tick broke.

    Attributes:
        tick: number of the tick.
        robot: its name; "" for the whole run.
        rule: name of the rule, one of the table of this module.
        message: text with the figures in SI.
    """

    tick: int
    robot: str
    rule: str
    message: str

    def __str__(self) -> str:
        """The violation in one line."""
        return f"tick {self.tick}: {f'{self.robot}: ' if self.robot else ''}{self.rule}: {self.message}"


def check_session(session: Session) -> Iterator[Violation]:
    """Violations in the order of the ticks.

    Raises:
        SessionError: the session has no robot file that this version reads, or no tick.
    """
    configs = {config.name: config for config in build_robot_configs(session.robot_file(), session.rate_hz)}
    robots = [_RobotCheck(configs[robot.name]) for robot in session.layout.robots]
    events: list[RunEvent] = []
    before: TickRecord | None = None
    for entry in session.entries():
        if entry.event is not None:
            events.append(entry.event)
        if entry.values is None:
            continue
        record = session.layout.decode(tuple(entry.values))
        # A recorder that is behind writes the events of several ticks before their records.
        later = [event for event in events if getattr(event, "tick", record.tick) > record.tick]
        events = [event for event in events if event not in later]
        lost = any(isinstance(event, RecorderOverrun) for event in events)
        gap = before is None or lost
        if before is not None:
            yield from _time(before, record, lost)
        for robot, now in zip(robots, record.robots, strict=True):
            if gap:
                robot.forget()
            for rule, message in robot.tick(record.tick, now, events):
                yield Violation(record.tick, robot.name, rule, message)
        before, events = record, later
    if before is None:
        raise SessionError(f"{session.path}: has no tick, so no motion to check; record a run")


def _time(before: TickRecord, now: TickRecord, lost: bool) -> Iterator[Violation]:
    if not (now.tick > before.tick and now.deadline_s > before.deadline_s and now.skipped >= before.skipped):
        yield Violation(now.tick, "", "time", f"tick or deadline not after those of tick {before.tick}")
    elif not lost and now.tick - before.tick != 1 + now.skipped - before.skipped:
        skipped = now.skipped - before.skipped
        yield Violation(now.tick, "", "time", f"follows tick {before.tick}, with {skipped} skipped between")


class _RobotCheck:
    """The ticks of one robot."""

    def __init__(self, config: RobotConfig) -> None:
        self.name = config.name
        self._config = config
        h = config.period_s
        powers = zip((config.velocity, config.acceleration, config.jerk), (h, h * h, h**3), strict=True)
        self._most = tuple([tuple([rate * power for rate in rates]) for rates, power in powers])
        self._follow = FollowCheck(config)
        self._yields = self._slowed = False
        self._travel = [axis.upper - axis.lower for axis in config.limits]
        self._room = [_ROUNDING * max(abs(axis.lower), abs(axis.upper)) for axis in config.limits]
        self.forget()

    def forget(self) -> None:
        """Records are missing: nothing is compared with earlier ones."""
        self._follow.forget()
        self._before: RobotRecord | None = None
        self._earlier: RobotRecord | None = None
        self._steps: Sequence[float] | None = None
        self._planned: deque[tuple[float, ...]] = deque(maxlen=4)
        self._beside = False
        self._sent = True
        self._cleared = False

    def tick(self, tick: int, now: RobotRecord, events: Sequence[RunEvent]) -> Iterator[tuple[str, str]]:
        """Rules broken in a tick, with messages."""
        orders = [each.order for each in events if isinstance(each, OrderGiven) and self._meant(each)]
        for event in events:
            if isinstance(event, PathSlowed):
                self._slowed = not event.over
        for order in orders:
            if order["order"] == Grip.NAME:
                self._follow.effort_share = float(order["share"])
            if order["order"] != Measured.NAME and order.get("robot", self.name) == self.name:
                self._yields = "until_force_n" in order
        before = self._before
        yield from self._faults(before, now, events, [str(order["order"]) for order in orders])
        command = tuple([axis.command for axis in now.axes])
        sent = not any(math.isnan(axis.device) for axis in now.axes)
        if orders and orders[-1]["order"] == "estop" and (sent or now.mode not in (Mode.OFF, Mode.FAULT)):
            yield "estop", f"{Mode(now.mode).name}{', commanded' if sent else ''} in the tick of the order"
        yield from (("follow", far) for far in self._follow.tick(now, self._yields))
        if sent and before is not None:
            yield from self._motion(before, now, command, disturbed=bool(events))
        if not sent:
            self._steps = None
            self._planned.clear()
        self._earlier, self._before, self._sent = before, now, sent

    def _meant(self, event: OrderGiven) -> bool:
        robots = event.order.get("robots")
        return robots is None or self.name in robots

    def _faults(
        self, before: RobotRecord | None, now: RobotRecord, events: Sequence[RunEvent], orders: Sequence[str]
    ) -> Iterator[tuple[str, str]]:
        was = Mode.OFF if before is None else before.mode
        # Devices may take some ticks to be cleared.
        self._cleared = bool({ClearFault.NAME, Recover.NAME} & {*orders}) or (
            self._cleared and was == Mode.FAULT
        )
        if now.mode == Mode.FAULT and was != Mode.FAULT and before is not None:
            reported = [each for each in events if isinstance(each, FaultLatched) and each.robot == self.name]
            if not any(each.fault == now.fault for each in reported):
                yield "fault", f"fault {now.fault} without its event"
        if now.fault in _OF_THE_BODY and (before is None or before.fault != now.fault):
            yield "follow", f"fault {now.fault} {Fault(now.fault).name.lower().replace('_', '-')}"
        if was == Mode.FAULT != now.mode and not self._cleared:
            yield "fault", f"{Mode(now.mode).name} after FAULT without an order to clear it"

    def _motion(
        self, before: RobotRecord, now: RobotRecord, command: tuple[float, ...], disturbed: bool
    ) -> Iterator[tuple[str, str]]:
        last = tuple([axis.command for axis in before.axes])
        first = not self._sent or any(map(math.isnan, last))
        if first:
            yield from self._arming(before, command)
            if any(map(math.isnan, last)):
                last = command
        steps = [new - old for new, old in zip(command, last, strict=True)]
        most_steps, most_changes, most_jerks = self._most
        for k, (axis, limits) in enumerate(zip(self._config.axes, self._config.limits, strict=True)):
            room, value, old = self._room[k], command[k], last[k]
            most_step, most_change = most_steps[k], most_changes[k]
            if not min(limits.lower, old) - room <= value <= max(limits.upper, old) + room:
                yield "position", f"{axis} at {value:.9g}, limits {limits.lower:.9g} to {limits.upper:.9g}"
            if abs(steps[k]) > most_step * (1.0 + _ROUNDING) + room:
                yield "velocity", f"{axis} {steps[k] / most_step:.6g} times its limit"
            change = steps[k] - (0.0 if self._steps is None else self._steps[k])
            if abs(change) > most_change * (1.0 + _ROUNDING) + 2.0 * room:
                yield "acceleration", f"{axis} {change / most_change:.6g} times its limit"
        limited = any(axis.limits > 0.0 for axis in now.axes)
        if now.mode == Mode.RUN or now.mode != before.mode:
            self._planned.clear()
            self._beside = limited
        elif disturbed or limited:
            self._planned.clear()
            self._beside |= limited
        self._planned.append(command)
        if len(self._planned) == 4:
            part = _SLOWED if self._slowed else 1.0
            jolts = [
                f"{self._config.axes[k]} {third / most_jerks[k]:.6g} times its limit"
                for k, third in enumerate(self._thirds())
                if abs(third) > part * most_jerks[k] * (1.0 + _JERK_ROUNDING) + 8.0 * self._room[k]
            ]
            # After a limited command the axes go back to their plan, within their acceleration alone.
            if not self._beside:
                yield from (("jerk", jolt) for jolt in jolts)
            self._beside = self._beside and bool(jolts)
        arrived = self._stands(steps) and not self._stands(self._steps or steps)
        if now.mode in _STOPS and arrived and self._shed_evenly():
            self._planned.clear()
        self._steps = steps

    def _stands(self, steps: Sequence[float]) -> bool:
        return all(abs(step) <= 2.0 * room for step, room in zip(steps, self._room, strict=True))

    def _shed_evenly(self) -> bool:
        """True when every axis shed as much speed in this tick as in the one before."""
        if len(self._planned) < 4:
            return True
        return all(abs(third) <= 8.0 * room for third, room in zip(self._thirds(), self._room, strict=True))

    def _thirds(self) -> list[float]:
        """Third difference of the last four commands of every axis."""
        return [d - 3.0 * c + 3.0 * b - a for a, b, c, d in zip(*self._planned, strict=True)]

    def _arming(self, before: RobotRecord, command: tuple[float, ...]) -> Iterator[tuple[str, str]]:
        # Arming began at the last measurement or at the one before it, from which noise may differ.
        measured = [self._measured(each) for each in (before, self._earlier or before)]
        if measured[0] is None:
            yield "arming", "the first command has no measurement before it"
            return
        for axis, new, travel, step, *olds in zip(
            self._config.axes, command, self._travel, self._most[0], *filter(None, measured), strict=True
        ):
            old = min(olds, key=lambda each: abs(new - each))
            if abs(new - old) > ARMING_SHARE * travel + step:
                yield "arming", f"{axis} begins at {new:.6g}, measured {old:.6g}"

    def _measured(self, record: RobotRecord) -> tuple[float, ...] | None:
        """Actuation at the measurements of a record; None where one is missing."""
        values = tuple([axis.value for axis in record.axes])
        return None if any(map(math.isnan, values)) else self._config.transmission.to_actuation(values)
