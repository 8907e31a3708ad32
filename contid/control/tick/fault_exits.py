"""How a robot leaves a fault: cleared after a new check, or recovered inside its limits; pure functions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from contid.control.tick.axis_motions import outside
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.state import Effect, OrderRefusedError, RobotState
from contid.control.tick.supervisor import Event, Mode
from contid.control.tick.transitions import apply_event, brakes_in_fault
from contid.hal import Sample


def recover(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Move inside the limits, slowly, then hold: out of the fault that reports it, or from HOLD.

    Raises:
        OrderRefusedError: the robot is not outside its limits, or in another state.
    """
    if state.mode is Mode.HOLD and state.command:
        if not outside(config, state.command):
            raise OrderRefusedError(
                f"{config.name}: every axis is within its limits; there is nothing to recover"
            )
        if any(state.increments):
            raise OrderRefusedError(f"{config.name}: still braking; recover again when it stands")
        return replace(state, follow=False, goto=None, recovering=True)
    if state.mode is Mode.FAULT and state.fault is not Fault.OUTSIDE_LIMITS:
        raise OrderRefusedError(
            f"{config.name}: recover is for fault {int(Fault.OUTSIDE_LIMITS)}, "
            f"this is fault {int(state.fault)} ({state.message})"
        )
    if brakes_in_fault(config, state):
        raise OrderRefusedError(f"{config.name}: still braking; recover when it stands")
    after = _without_fault(config, apply_event(config, state, Event.RECOVER, now_s))
    return replace(after, arm_requested=True, recovering=True)


def ask_clear(config: RobotConfig, state: RobotState, now_s: float) -> RobotState:
    """Request the devices to clear their faults; their answer leaves FAULT (`clear`).

    Raises:
        OrderRefusedError: there is no fault, or the robot still brakes: READY would end its commands at once.
    """
    if state.mode is not Mode.FAULT:
        return clear(config, state, (), now_s)  # refuses, with the orders that are possible
    if brakes_in_fault(config, state):
        raise OrderRefusedError(f"{config.name}: still braking; clear the fault when it stands")
    return replace(state, pending=(*state.pending, Effect.CLEAR))


def clear(config: RobotConfig, state: RobotState, samples: Sequence[Sample], now_s: float) -> RobotState:
    """Leave a fault after a new check of all samples; never moves, never changes torque.

    Raises:
        OrderRefusedError: a device is still faulty, or there is no fault.
    """
    wrong = "; ".join(_wrong(config, samples))
    if state.mode is Mode.FAULT and wrong:
        raise OrderRefusedError(f"{config.name}: not cleared, {wrong}")
    return _without_fault(config, apply_event(config, state, Event.CLEAR, now_s))


def _without_fault(config: RobotConfig, state: RobotState) -> RobotState:
    """The state without its fault; the devices may have lost torque, so arming starts again from samples."""
    misses = (0,) * len(config.axes)
    return replace(state, fault=Fault.NONE, message="", enabled=False, misses=misses, policy=None)


def _wrong(config: RobotConfig, samples: Sequence[Sample]) -> list[str]:
    """What would be a fault of an axis in the next tick, and a bus that is not open."""
    found = []
    for axis, sample, stale_s in zip(config.axes, samples, config.stale_s, strict=False):
        if sample.fault:
            found.append(f"{axis} reports {sample.fault}")
        elif not sample.valid:
            found.append(f"{axis} is silent")
        elif sample.age_s > stale_s and config.motion_rules > 5:
            found.append(f"{axis} repeats a measurement that is {sample.age_s:.3g} s old")
    return found if len(samples) == len(config.axes) else [*found, "its bus is not open"]
