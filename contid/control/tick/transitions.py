"""How orders and faults change the state of one robot: pure functions, one per order or event.

Each takes the state and returns the next one. Three parts of a state belong together:

* ``mode``: `apply_event` looks the next one up in `contid.control.tick.supervisor.MOVES`, or refuses;
* the orders that stand: ``arm_requested``, ``follow`` (a source of targets), ``goto`` (one target),
  ``recovering`` (inside the limits), ``policy`` (of a stop). A stop or a fault drops all but the last;
* ``pending``: what the devices are asked for next. No function here touches a device; the engine asks them.

A robot brakes by a ``motion`` of its commands (`contid.control.tick.axis_motions.braking`), which the ticks
follow. `bring_to_rest` is the end of it: no commands any more, the devices asked to hold, relax or vent.

The order of this file: the event, following and moving, stops, faults; `fault_exits` has what leaves a fault.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from contid.control.tick.axis_motions import (
    approach_after_stop,
    braking,
    braking_at_once,
    motion_to,
    outside,
    planned,
    rates,
    shares_limits,
)
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import WITHOUT_MODEL, Fault
from contid.control.tick.squeezing import Squeeze
from contid.control.tick.state import Effect, OrderRefusedError, RobotState
from contid.control.tick.supervisor import (
    ARMED,
    BY_STRENGTH,
    REST_OF,
    Event,
    Mode,
    allowed,
    move,
    order_of,
    stronger,
)
from contid.hal import Rest
from contid.robot_file.base import StopPolicy
from contid.targets import Actuation, Target

#: Share of velocity, acceleration and jerk of the motion back from a contact.
RETREAT_SHARE: Final = 0.2
#: Modes in which a tip closes on an object, and holds it.
_SQUEEZING: Final = (Mode.APPROACH, Mode.HOLD)
#: Faults with which the devices of a robot are out of reach.
_DEVICES_LOST: Final = (Fault.DEVICE_LOST, Fault.BUS_STALLED, Fault.DRIVER_ENDED)
#: Rests of devices, from the one that leaves most power to the one that leaves least.
_BY_POWER: Final = tuple(dict.fromkeys(Effect(REST_OF[policy]) for policy in BY_STRENGTH))


def apply_event(config: RobotConfig, state: RobotState, event: Event, now_s: float) -> RobotState:
    """The state in the mode to which an event leads; a mode without a squeeze ends it.

    Raises:
        OrderRefusedError: the event means nothing in this mode.
    """
    mode = move(state.mode, event)
    if mode is None:
        raise OrderRefusedError(
            f"{config.name}: cannot {order_of(event)} while {state.mode.name}{_why(state)}; "
            f"possible now: {', '.join(allowed(state.mode))}"
        )
    squeeze = state.squeeze if mode in _SQUEEZING else None
    return replace(state, mode=mode, since_s=now_s, squeeze=squeeze)


def _why(state: RobotState) -> str:
    """The cause of a fault, in brackets behind its mode; "" without one."""
    return f" ({state.message})" if state.mode is Mode.FAULT else ""


def _brakes_first(config: RobotConfig) -> bool:
    """Whether braking goes before orders: a weaker stop, another way, or clearing a fault.

    Since motion rules 4; recordings made by older ones replay without it.
    """
    return config.motion_rules > 3


def connect(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """The buses are open: wait for a valid sample of every axis."""
    return replace(apply_event(config, state, Event.CONNECT, now_s), misses=(0,) * len(config.axes))


def resume(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Arm if needed and follow the source; from OFF wait for samples first."""
    if state.mode is Mode.FAULT or state.mode is Mode.STOPPING:
        return apply_event(config, state, Event.ARM, now_s)  # refuses, with the orders that are possible
    if state.recovering:
        raise OrderRefusedError(f"{config.name}: on its way inside its limits; resume when it holds")
    if state.mode is Mode.OFF:
        state = connect(config, state, now_s)
    state = without_squeeze(config, state, now_s)
    on_its_way = state.goto is not None and state.mode is Mode.APPROACH
    if on_its_way and _brakes_first(config):
        state = stay(config, state, now_s)  # the way to its goto leads elsewhere
    return replace(state, arm_requested=True, follow=True, goto=None)


def follow(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Follow the source, as `resume` does, but never arm.

    Raises:
        OrderRefusedError: the robot is not armed; it may have been stopped since the order was given.
    """
    if state.mode not in ARMED:
        raise OrderRefusedError(f"{config.name} is {state.mode.name}{_why(state)}, not armed; resume first")
    return resume(config, state, now_s)


def hold(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Stop jerk-limited and stay; a robot that is being armed stays where it is.

    Raises:
        OrderRefusedError: the robot is not armed, or stops.
    """
    if state.mode is Mode.STOPPING and state.policy is not None:
        goes_on = f"its stop by {state.policy.value} goes on"
        raise OrderRefusedError(f"{config.name}: cannot hold while STOPPING: {goes_on}")
    if state.mode in (Mode.HOLD, Mode.CONNECTING, Mode.READY, Mode.ARMING):
        after = replace(without_squeeze(config, state, now_s), recovering=False)
    else:
        after = stay(config, state, now_s)
    return replace(after, follow=False, goto=None)


def stay(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """To HOLD with a jerk-limited stop from the present motion; what it follows stays ordered."""
    return braking(config, replace(apply_event(config, state, Event.HOLD, now_s), recovering=False), now_s)


def without_squeeze(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """The state without a squeeze, whose tip stops jerk-limited where it is."""
    return state if state.squeeze is None else braking(config, state, now_s)


def goto(
    config: RobotConfig, state: RobotState, target: Target, now_s: float, until_force_n: float | None = None
) -> RobotState:
    """Go to one target, then hold; needs an armed robot, which may be on its way elsewhere.

    With a force the tip closes slowly until it exerts that force along its way, and holds it.
    """
    if state.mode is not Mode.APPROACH and move(state.mode, Event.FOLLOW) is None:
        return apply_event(config, state, Event.FOLLOW, now_s)  # refuses, with the orders that are possible
    if far := outside(config, state.command):
        raise OrderRefusedError(f"{config.name}: {far}; recover first")
    if until_force_n is not None:
        _require_squeezable(config, state, target)
    # It stands before it goes: its motion leads elsewhere.
    state = without_squeeze(config, state, now_s) if state.mode is Mode.HOLD else stay(config, state, now_s)
    squeeze = None if until_force_n is None else Squeeze(until_force_n)
    return replace(state, follow=False, goto=target, squeeze=squeeze)


def _require_squeezable(config: RobotConfig, state: RobotState, target: Target) -> None:
    """Refuse a move until a force that cannot be measured or begin here."""
    if state.squeeze is not None and state.squeeze.reached:
        raise OrderRefusedError(f"{config.name}: it holds an object; move back from it first")
    if config.squeezes is None:
        why = "no force follows from its currents without sense.nm_per_a in the robot file"
    else:
        why = config.squeezes.why_not(config, state.command, config.frame.target_in_base(target))
    if why:
        raise OrderRefusedError(f"{config.name}: {why}")


def retreat(config: RobotConfig, state: RobotState, goal: Actuation, now_s: float) -> RobotState:
    """From HOLD at standstill, go slowly to an earlier command, then hold."""
    motion = motion_to(config, state.command, rates(config, state), goal, RETREAT_SHARE)
    after = apply_event(config, state, Event.FOLLOW, now_s)
    return replace(
        after, motion=motion, motion_s=now_s - config.period_s, goto=Target(actuation=goal), follow=False
    )


def stop(config: RobotConfig, state: RobotState, policy: StopPolicy, now_s: float) -> RobotState:
    """Begin to stop by a policy; the devices of a robot not armed, or standing in FAULT, rest at once.

    A stop that runs goes on where the new one would leave more power.
    """
    after = _without_orders(apply_event(config, state, Event.STOP, now_s))
    if state.policy is not None and _brakes_first(config):
        policy = stronger(policy, state.policy)
        if state.mode is Mode.STOPPING and policy is state.policy:
            return state
    if brakes_in_fault(config, state) and policy is not StopPolicy.VENT:
        return replace(after, policy=policy)
    if after.mode in (Mode.OFF, Mode.FAULT):
        return _stop_at_standstill(state, after, policy)
    if not state.command or policy is StopPolicy.VENT:
        return end_stop(config, replace(after, policy=policy), now_s)
    to_rest = policy is StopPolicy.REST and not outside(config, state.command)
    if to_rest and not shares_limits(config):
        motion = motion_to(config, state.command, rates(config, state), config.rest)
        return replace(planned(after, motion, now_s - config.period_s), policy=policy)
    braked = braking(config, replace(after, policy=policy), now_s)
    return approach_after_stop(config, braked, config.rest, now_s - config.period_s) if to_rest else braked


def _stop_at_standstill(state: RobotState, after: RobotState, policy: StopPolicy) -> RobotState:
    """A stop of a robot without motion: its devices rest, unless they rest already and are to hold.

    To hold would close the valve of an arm that vents.
    """
    had_power = state.was_armed or state.mode is Mode.FAULT
    if state.enabled or (had_power and REST_OF[policy] is not Rest.HOLD):
        return bring_to_rest(after, policy)
    return replace(after, enabled=False, motion=None)


def end_stop(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """The stop is done: OFF, or still in FAULT, the devices at the rest of its policy."""
    assert state.policy is not None
    after = state if state.mode is Mode.FAULT else apply_event(config, state, Event.STOPPED, now_s)
    return bring_to_rest(after, state.policy)


def estop(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Relax or vent now, from any state; OFF afterwards, a latched fault stays. Never refused."""
    if state.mode is not Mode.OFF:
        state = apply_event(config, state, Event.ESTOP, now_s)
    return bring_to_rest(_without_orders(state), config.stops.estop)


def bring_to_rest(state: RobotState, policy: StopPolicy) -> RobotState:
    """The state disabled and without a running stop, its devices asked for the rest of a policy.

    A rest that was asked for before in this tick, such as that of an emergency stop, is asked for as well,
    and alone where it leaves no more power; a request to arm or to clear is dropped.
    """
    effect, before = Effect(REST_OF[policy]), _pending_rests(state)
    no_more_power = _BY_POWER[_BY_POWER.index(effect) :]
    pending = before if any(each in no_more_power for each in before) else (*before, effect)
    return replace(state, pending=pending, enabled=False, motion=None, policy=None)


def _without_orders(state: RobotState) -> RobotState:
    return replace(state, arm_requested=False, follow=False, goto=None, recovering=False)


def _pending_rests(state: RobotState) -> tuple[Effect, ...]:
    """What is pending of a robot but requests to arm or to clear."""
    return tuple(each for each in state.pending if isinstance(each.value, Rest))


def fail(config: RobotConfig, state: RobotState, fault: Fault, message: str, now_s: float) -> RobotState:
    """Latch a fault and stop by the policy ``on_fault``; a fault that is latched already stays."""
    if state.mode is Mode.FAULT:
        return state
    after = latch_fault(config, state, fault, message, now_s)
    lost = fault in _DEVICES_LOST
    if not lost and state.mode is Mode.ARMING:  # its devices may have been enabled
        return bring_to_rest(after, config.stops.on_fault)
    if lost or not state.enabled:
        # Only the devices' own watchdogs can act; those on other buses the exchange brings to rest.
        return replace(after, enabled=False, motion=None, policy=None)
    if config.stops.on_fault is StopPolicy.HOLD and state.command:
        brake = braking_at_once if fault in WITHOUT_MODEL else braking
        return brake(config, after, now_s)
    return bring_to_rest(after, config.stops.on_fault)


def latch_fault(
    config: RobotConfig, state: RobotState, fault: Fault, message: str, now_s: float
) -> RobotState:
    """The state with a fault, without the orders before it but for a stop; its motion goes on.

    A robot that was being stopped rests by the policy of that stop when it stands.
    """
    after = _without_orders(apply_event(config, state, Event.FAULT, now_s))
    policy = state.policy if _brakes_first(config) else None
    return replace(after, fault=fault, message=message, policy=policy, pending=_pending_rests(state))


def too_near(config: RobotConfig, state: RobotState, message: str, now_s: float) -> RobotState:
    """Latch fault 303 and stop in the shortest way, whatever the policy: to relax would move the body."""
    return braking_at_once(config, latch_fault(config, state, Fault.TOO_NEAR, message, now_s), now_s)


def brakes_in_fault(config: RobotConfig, state: RobotState) -> bool:
    """True while a robot in FAULT is commanded to its standstill, which no order but an estop may end."""
    moves = any(state.increments) or state.shaped.ticks_left > 0
    return state.mode is Mode.FAULT and state.enabled and moves and _brakes_first(config)
