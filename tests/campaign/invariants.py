"""What must hold of modes, faults and records in every case; `ALONE` lists every check.

Each check yields one line per violation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

from contid.control.engine import messages as msg
from contid.control.engine.events.robots import FaultLatched, ModeChanged
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.wiring import chain_guards
from contid.control.tick.config import STALE_S
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid_drivers.sim.options import FaultKind
from tests.campaign.motion_invariants import apart, no_jump, position, rates, robots_of, taut
from tests.campaign.script import HEALED_S, RESUMED_S
from tests.campaign.watch import Seen

_WATCHED = (Mode.READY, Mode.ARMING, Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING)


def detected(seen: Seen) -> Iterator[str]:
    """A robot that watches its devices is in FAULT within the stated ticks of what ails them."""
    case = seen.case
    if any(fault.kind is FaultKind.LATE for fault in case.faults):
        return  # late exchanges move every edge in time
    rate_hz = case.machine.rate_hz
    for fault in case.faults:
        for robot, config in robots_of(seen):
            if not fault.touches(case.machine, config) or fault.kind is FaultKind.STALL:
                continue
            tolerance = max(config.tolerance)
            allowed = {
                FaultKind.SILENT: tolerance + 1,
                FaultKind.STALE: math.ceil(max(tolerance, STALE_S * rate_hz)) + 2,
                FaultKind.OVERLOAD: 2,
                FaultKind.LOST: 2,
            }[fault.kind]
            hiding = [
                other
                for other in case.faults
                if other is not fault and (other.kind is FaultKind.LOST or other.axis == fault.axis)
            ]
            ticks = 0
            for record in seen.records:
                on = fault.tick <= record.tick < fault.tick + fault.ticks
                hidden = any(other.tick <= record.tick < other.tick + other.ticks + 2 for other in hiding)
                watching = record.robots[robot].mode in _WATCHED
                ticks = ticks + 1 if on and watching and not hidden else 0
                if ticks > allowed:
                    yield f"{config.name}: {fault.kind} unnoticed for {ticks} ticks at {record.tick}"
                    return


def latched(seen: Seen) -> Iterator[str]:
    """A fault stays until an order ends it, and each has its event."""
    orders = (msg.ClearFault, msg.Stop, msg.Estop, msg.Finish)
    reported = {(e.robot, e.tick) for e in seen.events if isinstance(e, FaultLatched)}
    for robot, config in robots_of(seen):
        for was, now in pairwise(seen.records):
            old, new = was.robots[robot].mode, now.robots[robot].mode
            given = [
                message
                for tick in range(was.tick + 1, now.tick + 1)
                for message in seen.case.orders.get(tick, ())
                if isinstance(message, orders)
            ]
            if old == Mode.FAULT != new and not given:
                yield f"{config.name}: FAULT left without an order at {now.tick}"
                return
            if old != Mode.FAULT == new and (config.name, now.tick) not in reported:
                yield f"{config.name}: FAULT at {now.tick} has no event"
                return


def estop(seen: Seen) -> Iterator[str]:
    """After an emergency stop: OFF (a fault stays), and no command in that tick."""
    case = seen.case
    place_of = {record.tick: place for place, record in enumerate(seen.records)}
    for tick, messages in case.orders.items():
        place = place_of.get(tick)
        for at, message in enumerate(messages):
            if place is None or not isinstance(message, msg.Estop) or messages[at + 1 :]:
                continue
            for robot, config in robots_of(seen):
                if message.robots is not None and config.name not in message.robots:
                    continue
                state = seen.records[place].robots[robot]
                before = seen.records[place - 1].robots[robot].mode if place else Mode.OFF
                resting = state.mode == Mode.OFF or state.mode == before == Mode.FAULT
                if not resting or not all(math.isnan(axis.device) for axis in state.axes):
                    yield f"{config.name}: {Mode(state.mode).name} after estop at {tick}"
                deaf = {
                    axis
                    for fault in case.faults
                    if fault.tick <= tick < fault.tick + fault.ticks and fault.touches(case.machine, config)
                    for axis in ([fault.axis] if fault.axis else config.axes)
                } | {axis for axis in config.axes if case.machine.bus_of[axis] in seen.lost[place]}
                if still := seen.powered[place] & (set(config.axes) - deaf):
                    yield f"{config.name}: {', '.join(sorted(still))} powered after estop at {tick}"


def complete(seen: Seen) -> Iterator[str]:
    """Every tick has a record or was counted as skipped; every change of state is an event."""
    ticks = [record.tick for record in seen.records]
    missing = (ticks[-1] + 1 - len(ticks)) if ticks else 0
    counted = seen.records[-1].skipped if ticks else 0
    if sorted(set(ticks)) != ticks or missing != counted:
        yield f"{missing} ticks without a record, {counted} counted as skipped"
    for robot, config in robots_of(seen):
        reported = [e for e in seen.events if isinstance(e, ModeChanged) and e.robot == config.name]
        mode, modes = Mode.OFF, {e.tick: Mode[e.mode] for e in reported}
        for record in seen.records:
            mode = modes.get(record.tick, mode)
            if record.robots[robot].mode != mode:
                was = Mode(record.robots[robot].mode).name
                yield f"{config.name}: {was} at {record.tick}, events give {mode.name}"
                return


_FOLLOWING = (Mode.APPROACH, Mode.RUN, Mode.HOLD)


def controllable(seen: Seen) -> Iterator[str]:
    """With the faults over, clear and resume bring every robot back; then the run ends by itself."""
    if seen.case.dies_at is not None:
        return
    if not seen.finished:
        yield f"not finished after {len(seen.records)} ticks"
        return
    finish = next(
        tick for tick, given in seen.case.orders.items() if any(isinstance(m, msg.Finish) for m in given)
    )
    resumed = round((RESUMED_S - 0.1) * seen.case.machine.rate_hz) + 2
    healed = round(HEALED_S * seen.case.machine.rate_hz)
    before = next(r for r in reversed(seen.records) if r.tick < resumed)
    record = next(r for r in reversed(seen.records) if r.tick < finish)
    for robot, config in robots_of(seen):
        state = record.robots[robot]
        if before.robots[robot].mode == Mode.STOPPING:
            continue  # a stop that was ordered is not resumed; it ends in OFF
        came_back = before.robots[robot].mode in _FOLLOWING or any(
            r.robots[robot].mode == Mode.ARMING for r in seen.records if healed <= r.tick < finish
        )
        if _forbidden(seen, record, robot) and came_back:
            # It did come back; what rope or clearance forbid is forbidden again until it is moved, and what a
            # stalled motor left outside is outside until it is recovered.
            continue
        if state.mode not in (*_FOLLOWING, Mode.STOPPING):
            yield f"{config.name}: {Mode(state.mode).name} (fault {state.fault}) after clear and resume"


def _forbidden(seen: Seen, record: TickRecord, robot: int) -> bool:
    """In FAULT for its way, or for the way of another arm of its rope."""
    fault = record.robots[robot].fault
    if fault != Fault.CHAIN_BROKEN:
        stalled = any(each.kind is FaultKind.STALL for each in seen.case.faults)
        forbidden = (Fault.CHAIN_FORBIDS, Fault.TOO_NEAR, *([Fault.OUTSIDE_LIMITS] if stalled else []))
        return fault in forbidden
    name = seen.case.machine.configs[robot].name
    chain = next(guard.arms for guard in chain_guards(seen.case.machine.loaded) if name in guard.arms)
    others = [state for at, state in enumerate(record.robots) if seen.case.machine.configs[at].name in chain]
    return any(state.fault == Fault.CHAIN_FORBIDS for state in others)


def watchdog(seen: Seen) -> Iterator[str]:
    """However the host ended, no device obeys once its watchdog time is over."""
    if seen.powered_at_end:
        yield f"{', '.join(sorted(seen.powered_at_end))} powered without a host"


def unaffected(seen: Seen, reference: Seen) -> Iterator[str]:
    """Robots that no fault touches get the very bytes they get without the faults; a chain is one body."""
    case = seen.case
    late = any(fault.kind is FaultKind.LATE for fault in case.faults)
    if late or case.coupled or seen is reference:
        return
    configs = {config.name: config for config in case.machine.configs}
    bodies: list[tuple[str, ...]] = [guard.arms for guard in chain_guards(case.machine.loaded)]
    if case.machine.loaded.file.clearance is not None:  # one stops where the other is in its way
        bodies.append(tuple(case.machine.loaded.file.clearance.bodies))
    for robot, config in robots_of(seen):
        body = next((arms for arms in bodies if config.name in arms), (config.name,))
        if any(fault.touches(case.machine, configs[name]) for fault in case.faults for name in body):
            continue
        for mine, theirs in zip(seen.records, reference.records, strict=False):
            for a, b in zip(mine.robots[robot].axes, theirs.robots[robot].axes, strict=True):
                if a.device.hex() != b.device.hex():
                    yield f"{config.name}: {a.device} instead of {b.device} at {mine.tick}"
                    return


ALONE: dict[str, Callable[[Seen], Iterator[str]]] = {
    "position limits": position,
    "velocity and acceleration limits": rates,
    "tensions of tendons": taut,
    "no jump on arming": no_jump,
    "fault within the stated ticks": detected,
    "faults latch and are reported": latched,
    "estop within the tick": estop,
    "records and events complete": complete,
    "controllable, and ends": controllable,
    "no power without a host": watchdog,
    "bodies never nearer than stated": apart,
}
UNAFFECTED = "other robots unaffected"
