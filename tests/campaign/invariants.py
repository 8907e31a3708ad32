"""What must hold in every case, whatever happened; each check yields one line per violation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from contid.clearance.guard import Shapes
from contid.control.engine import messages as msg
from contid.control.engine.events.robots import FaultLatched, ModeChanged
from contid.control.engine.tick_layout import ENABLED, TickRecord
from contid.control.engine.wiring import chain_guards, clearance_guard
from contid.control.tick.config import STALE_S, RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.supervisor import Mode
from contid.kinematics.tendon.model import TendonModel
from contid.targets import ZERO3
from contid_drivers.sim.options import FaultKind, SimAxisOptions
from tests.campaign.script import RESUMED_S
from tests.campaign.watch import Seen

#: Rounding of float64 in lengths of metres and pressures of 1e5 Pa, with room for a few operations.
ROUNDING = 1e-9
#: The same of tensions: a tolerance of 1 nm times the stiffness of a tendon.
TENSION_N = 1e-4
#: By which a pair may miss its margin: resolution of the check, and between samples of the bodies [m].
NEARER_M = 1.5e-4

_DRIVEN = (Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING, Mode.FAULT)
_WATCHED = (Mode.READY, Mode.ARMING, Mode.APPROACH, Mode.RUN, Mode.HOLD, Mode.STOPPING)


def _robots(seen: Seen) -> Iterator[tuple[int, RobotConfig]]:
    yield from enumerate(seen.case.machine.configs)


def _commands(seen: Seen, robot: int) -> Iterator[tuple[int, tuple[float, ...], tuple[float, ...]]]:
    """Place in the records, actuation and device values of every tick that commanded something."""
    for place, record in enumerate(seen.records):
        axes = record.robots[robot].axes
        device = tuple(axis.device for axis in axes)
        if not all(map(math.isnan, device)):
            yield place, tuple(axis.command for axis in axes), device


def position(seen: Seen) -> Iterator[str]:
    """Commands are numbers and inside the limits; an arm found outside only moves inwards."""
    for robot, config in _robots(seen):
        slack = [ROUNDING * max(abs(a.lower), abs(a.upper)) for a in config.limits]
        before: tuple[int, tuple[float, ...]] | None = None
        for place, command, device in _commands(seen, robot):
            if not all(map(math.isfinite, (*command, *device))):
                yield f"{config.name}: command {command} at {place}"
                return
            first = tuple(axis.command for axis in seen.records[place - 1].robots[robot].axes)
            last = before[1] if before is not None and before[0] == place - 1 else first
            for axis, value, old, room in zip(config.limits, command, last, slack, strict=True):
                if not min(axis.lower, old) - room <= value <= max(axis.upper, old) + room:
                    yield f"{config.name}: {value} outside {axis.lower}..{axis.upper} at {place}"
                    return
            before = place, command


def rates(seen: Seen) -> Iterator[str]:
    """Velocity and acceleration between consecutive commands, from standstill at the first."""
    for robot, config in _robots(seen):
        before, steps = -2, (0.0,) * len(config.axes)
        for place, command, _ in _commands(seen, robot):
            last = tuple(axis.command for axis in seen.records[place - 1].robots[robot].axes)
            if before != place - 1:
                steps = (0.0,) * len(config.axes)
            now = tuple(a - b for a, b in zip(command, last, strict=True))
            for axis, step, old in zip(config.limits, now, steps, strict=True):
                room = ROUNDING * max(abs(axis.lower), abs(axis.upper))
                if abs(step) > axis.step + room:
                    yield f"{config.name}: step {step} beyond {axis.step} at {place}"
                    return
                if abs(step - old) > axis.change + 2.0 * room:
                    yield f"{config.name}: change of step {step - old} beyond {axis.change} at {place}"
                    return
            before, steps = place, now


def taut(seen: Seen) -> Iterator[str]:
    """Tensions of a tendon robot: none under the floor or over the largest, beyond what arming found."""
    for robot, config in _robots(seen):
        model = config.model
        if not isinstance(model, TendonModel) or model.statics is None:
            continue
        before, low, high = -2, 0.0, 0.0
        for place, command, _ in _commands(seen, robot):
            tensions = model.statics.tensions(np.array(command))
            if before != place - 1:  # armed where it stands: measured tensions are what they are
                low = min(float(np.min(tensions)), model.statics.floor_n)
                high = max(float(np.max(tensions)), model.statics.limit_n)
            if np.min(tensions) < low - TENSION_N or np.max(tensions) > high + TENSION_N:
                yield f"{config.name}: tensions {np.min(tensions):.6g}..{np.max(tensions):.6g} N at {place}"
                return
            before = place


def no_jump(seen: Seen) -> Iterator[str]:
    """The first command after arming is what was measured, to rounding; no command without arming."""
    for robot, config in _robots(seen):
        armed = False
        for place, (was, now) in enumerate(pairwise(seen.records), 1):
            old, new = was.robots[robot], now.robots[robot]
            began = old.mode == Mode.ARMING and new.mode in _DRIVEN and not armed and new.flags & ENABLED
            # A fault between torque and first command: the devices hold by themselves, nothing is sent.
            if began and not math.isnan(new.axes[0].command):
                armed = True
                measured = tuple(axis.value for axis in old.axes)
                present = config.transmission.to_device(tuple(axis.command for axis in new.axes))
                for a, b in zip(present, measured, strict=True):
                    if not abs(a - b) <= _quantum(seen, config):
                        yield f"{config.name}: begins at {a}, measured {b}, at {place}"
                        return
            commanded = not all(math.isnan(axis.device) for axis in new.axes)
            if commanded and not armed:
                yield f"{config.name}: commanded without arming at {place}"
                return
            if not new.flags & ENABLED:
                armed = False


def _quantum(seen: Seen, config: RobotConfig) -> float:
    """Resolution of the coarsest simulated device [rad or Pa]."""
    from contid_drivers.sim.devices import character_of

    wiring = [
        bus for bus in seen.case.machine.loaded.buses.values() for axis, _ in bus.axes if axis in config.axes
    ]
    return max(
        character_of(options).quantum
        for bus in wiring
        for axis, options in bus.axes
        if axis in config.axes and isinstance(options, SimAxisOptions)
    )


def detected(seen: Seen) -> Iterator[str]:
    """A robot that watches its devices is in FAULT within the stated ticks of what ails them."""
    case = seen.case
    if any(fault.kind is FaultKind.LATE for fault in case.faults):
        return  # late exchanges move every edge in time
    rate_hz = case.machine.rate_hz
    for fault in case.faults:
        for robot, config in _robots(seen):
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
    for robot, config in _robots(seen):
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
            for robot, config in _robots(seen):
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
    for robot, config in _robots(seen):
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
    before = next(r for r in reversed(seen.records) if r.tick < resumed)
    record = next(r for r in reversed(seen.records) if r.tick < finish)
    for robot, config in _robots(seen):
        state = record.robots[robot]
        if before.robots[robot].mode == Mode.STOPPING:
            continue  # a stop that was ordered is not resumed; it ends in OFF
        came_back = before.robots[robot].mode in _FOLLOWING or any(
            r.robots[robot].mode == Mode.ARMING for r in seen.records if resumed <= r.tick < finish
        )
        if _forbidden(seen, record, robot) and came_back:
            continue  # it did come back; a way that rope or clearance forbid is forbidden again, until moved
        if state.mode not in (*_FOLLOWING, Mode.STOPPING):
            yield f"{config.name}: {Mode(state.mode).name} (fault {state.fault}) after clear and resume"


def _forbidden(seen: Seen, record: TickRecord, robot: int) -> bool:
    """In FAULT for its way, or for the way of another arm of its rope."""
    fault = record.robots[robot].fault
    if fault != Fault.CHAIN_BROKEN:
        return fault in (Fault.CHAIN_FORBIDS, Fault.TOO_NEAR)
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
    for robot, config in _robots(seen):
        body = next((arms for arms in bodies if config.name in arms), (config.name,))
        if any(fault.touches(case.machine, configs[name]) for fault in case.faults for name in body):
            continue
        for mine, theirs in zip(seen.records, reference.records, strict=False):
            for a, b in zip(mine.robots[robot].axes, theirs.robots[robot].axes, strict=True):
                if a.device.hex() != b.device.hex():
                    yield f"{config.name}: {a.device} instead of {b.device} at {mine.tick}"
                    return


def apart(seen: Seen) -> Iterator[str]:
    """Bodies never come nearer than the file states; those that are nearer already come no nearer."""
    guard = clearance_guard(seen.case.machine.loaded)
    if guard is None:
        return
    floors = dict.fromkeys(guard.pairs, -math.inf)
    before: dict[str, bool] = {}
    for place, record in enumerate(seen.records):
        at, driven = {}, {}
        for robot, config in _robots(seen):
            axes = record.robots[robot].axes
            driven[config.name] = not all(math.isnan(axis.device) for axis in axes)
            command = tuple(axis.command for axis in axes)
            values = tuple(axis.value for axis in axes)
            if driven[config.name]:
                at[config.name] = (command, ZERO3)
            elif all(map(math.isfinite, values)):
                at[config.name] = (config.transmission.to_actuation(values), ZERO3)
        shapes = Shapes(guard, at)
        for pair in guard.pairs:
            names = [name for name in pair if name in guard.arms]
            if not all(name in at for name in names):
                continue
            found = shapes.nearest(pair, guard.margin_m).distance
            # A robot without power may be moved by hand; it is followed only beyond noise.
            if not all(driven[name] and before.get(name, False) for name in names):
                floors[pair] = -math.inf
            if found.upper_m < floors[pair] - NEARER_M:
                yield f"{pair[0]} and {pair[1]} {found.upper_m * 1e3:.3f} mm apart at {place}"
                return
            floors[pair] = min(guard.margin_m, max(floors[pair], found.lower_m))
        before = driven


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
