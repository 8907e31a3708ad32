"""The tick is a pure function: same arguments, same answer, nothing else touched."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.control.tick import fault_exits, transitions
from contid.control.tick.arming import next_arming
from contid.control.tick.config import RobotConfig
from contid.control.tick.faults import Fault
from contid.control.tick.robot_tick import tick
from contid.control.tick.state import Effect, OrderRefusedError, RobotState
from contid.control.tick.supervisor import Mode
from contid.hal import Sample
from contid.robot_file.base import StopPolicy
from contid.targets import Solution, Target
from contid.trajectory.approach import Approach
from tests.support.fingers import load


@pytest.fixture
def config() -> RobotConfig:
    return build_robot_configs(load(2), 200.0)[1]


TARGET = Target(tip_m=(0.050, 0.075, 0.0))


def sampled(
    config: RobotConfig, actuation: tuple[float, ...] = (0.06, 0.06), **keys: Any
) -> tuple[Sample, ...]:
    device = config.transmission.to_device(actuation)
    return tuple(replace(Sample(value, 0.0, True, 0.0), **keys) for value in device)


def running(config: RobotConfig) -> RobotState:
    """A robot that stands exactly on the target, in RUN."""
    here = config.model.inverse(config.frame.target_in_base(TARGET), config.rest).actuation
    return RobotState(
        mode=Mode.RUN, enabled=True, arm_requested=True, follow=True, command=here, reference=here,
        increments=(0.0, 0.0), misses=(0, 0),
    )  # fmt: skip


def test_the_same_arguments_give_the_same_outcome(config: RobotConfig) -> None:
    state, samples = running(config), sampled(config)
    moved = Target(tip_m=(0.0501, 0.0751, 0.0))
    assert tick(config, state, 1.0, samples, moved) == tick(config, state, 1.0, samples, moved)


def test_on_its_target_the_tip_error_is_rounding(config: RobotConfig) -> None:
    out = tick(config, running(config), 1.0, sampled(config), TARGET)
    assert out.tip_error_m < 1e-15
    assert out.state.command == running(config).command
    assert out.device == config.transmission.to_device(out.state.command)


def test_directions_and_loads_are_mirrored_with_the_robot(config: RobotConfig) -> None:
    target = Target(tip_m=(0.09, 0.07, 0.0), direction=(0.6, 0.8, 0.0), load_n=(1.0, 2.0, 3.0))
    base = config.frame.target_in_base(target)
    assert base.tip_m == pytest.approx((0.01, 0.07, 0.0))
    assert base.direction == pytest.approx((-0.6, 0.8, 0.0))
    assert base.load_n == pytest.approx((-1.0, 2.0, 3.0))


def test_no_command_before_a_valid_sample_of_every_axis(config: RobotConfig) -> None:
    state = transitions.resume(config, RobotState(), 0.0)
    one_silent = (sampled(config)[0], Sample(None, 0.0, False, 0.0))
    for samples in ((), one_silent):
        out = tick(config, state, 0.1, samples, TARGET)
        assert (out.state.mode, out.device) == (Mode.CONNECTING, ())
    out = tick(config, state, 3.0, one_silent, TARGET)
    assert (out.state.fault, out.state.enabled) == (Fault.NO_SAMPLE, False)
    assert "f1.right" in out.state.message


def test_arming_starts_from_what_is_measured(config: RobotConfig) -> None:
    state = tick(config, transitions.resume(config, RobotState(), 0.0), 0.1, sampled(config), TARGET).state
    assert (state.mode, state.pending, state.command) == (Mode.ARMING, (Effect.ENABLE,), ())
    armed = replace(state, enabled=True, pending=())
    state = tick(config, armed, 0.2, sampled(config, (0.031, 0.047)), TARGET).state
    assert state.mode is Mode.APPROACH
    assert state.command == pytest.approx((0.031, 0.047), abs=1e-15)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_failed_read_is_never_a_position(config: RobotConfig, enabled: bool) -> None:
    """Samples do not steer: a silent axis changes counters, not the command."""
    state = replace(running(config), enabled=enabled)
    silent = (sampled(config)[0], replace(sampled(config)[1], valid=False, value=0.0))
    out = tick(config, state, 1.0, silent, TARGET)
    assert out.state.command == state.command
    assert out.state.misses == (0, 1)


@pytest.mark.parametrize("interruption", ["fault", "stop"])
def test_an_arming_that_is_interrupted_does_not_go_back_to_old_commands(
    config: RobotConfig, interruption: str
) -> None:
    """The robot was moved by hand since its last command; torque is on, but nothing was commanded yet."""
    ready = replace(running(config), mode=Mode.READY, enabled=False)
    arming = tick(config, ready, 1.0, sampled(config, (0.09, 0.03)), TARGET).state
    assert arming.mode is Mode.ARMING
    state = replace(arming, enabled=True, pending=())
    if interruption == "stop":
        state = transitions.stop(config, state, StopPolicy.HOLD, 1.005)
    for number in range(5):
        broken = sampled(config, (0.09, 0.03), fault="overload" if interruption == "fault" else "")
        out = tick(config, state, 1.005 + 0.005 * number, broken, TARGET)
        assert out.device == ()
        state = out.state
    assert state.mode is (Mode.FAULT if interruption == "fault" else Mode.OFF)
    assert state.pending == (Effect.HOLD,)
    assert not state.enabled


def test_a_model_that_answers_nan_is_a_fault_and_no_command(config: RobotConfig) -> None:
    class Wild:
        def __getattr__(self, name: str) -> Any:
            return getattr(config.model, name)

        def inverse(self, target: Target, seed: tuple[float, ...]) -> Solution:
            return Solution((math.nan, 0.05), 0.0, True)

    out = tick(replace(config, model=Wild()), running(config), 1.0, sampled(config), TARGET)
    assert out.state.fault is Fault.NOT_A_NUMBER
    assert all(map(math.isfinite, out.device))


def test_an_error_in_one_tick_is_that_robots_fault(config: RobotConfig) -> None:
    class Broken:
        def __getattr__(self, name: str) -> Any:
            raise ZeroDivisionError("oh")

    out = tick(replace(config, model=Broken()), running(config), 1.0, sampled(config), TARGET)
    assert out.state.fault is Fault.INTERNAL
    assert "ZeroDivisionError" in out.state.message


def test_the_first_fault_stays(config: RobotConfig) -> None:
    state = transitions.fail(config, running(config), Fault.AXIS_SILENT, "first", 1.0)
    again = transitions.fail(config, state, Fault.DEVICE_FAULT, "second", 2.0)
    assert (again.fault, again.message) == (Fault.AXIS_SILENT, "first")


def test_clear_looks_again_and_never_moves(config: RobotConfig) -> None:
    state = transitions.fail(config, running(config), Fault.DEVICE_FAULT, "hot", 1.0)
    for samples in ((), sampled(config, fault="hot"), sampled(config, valid=False)):
        with pytest.raises(OrderRefusedError):
            fault_exits.clear(config, state, samples, 2.0)
    cleared = fault_exits.clear(config, state, sampled(config), 2.0)
    assert (cleared.mode, cleared.fault) == (Mode.READY, Fault.NONE)
    out = tick(config, cleared, 3.0, sampled(config), TARGET)
    assert (out.state.mode, out.device, out.state.pending) == (Mode.READY, (), ())


@pytest.mark.parametrize("policy", [None, *StopPolicy])
def test_orders_do_not_end_the_braking_of_a_fault(config: RobotConfig, policy: StopPolicy | None) -> None:
    """The commands would end at once, in full motion: a stop waits for standstill, clear-fault is refused."""
    moving = replace(running(config), increments=tuple(each.change * 5.0 for each in config.limits))
    state = transitions.fail(config, moving, Fault.DEVICE_FAULT, "hot", 1.0)
    now_s = 1.0
    with pytest.raises(OrderRefusedError, match="still braking; clear the fault when it stands"):
        fault_exits.ask_clear(config, state, now_s)
    if policy is not None:
        state = transitions.stop(config, state, policy, 1.0)
    while state.enabled and any(state.increments):
        assert state.pending == ()
        now_s += config.period_s
        state = tick(config, state, now_s, sampled(config), None).state
        assert now_s < 5.0
    assert state.mode is Mode.FAULT
    if policy is None:
        assert fault_exits.ask_clear(config, state, now_s).pending == (Effect.CLEAR,)
        return
    resting = {"hold": Effect.HOLD, "rest": Effect.HOLD, "relax": Effect.RELAX, "vent": Effect.VENT}
    assert (state.pending, state.enabled, state.motion) == ((resting[policy.value],), False, None)
    assert now_s == 1.0 if policy is StopPolicy.VENT else now_s > 1.0


@pytest.mark.parametrize("policy", list(StopPolicy))
def test_a_stop_ends_in_the_rest_of_its_policy(config: RobotConfig, policy: StopPolicy) -> None:
    state = transitions.stop(config, running(config), policy, 1.0)
    now_s = 1.0
    while state.mode is Mode.STOPPING and now_s < 20.0:
        state = tick(config, state, now_s, sampled(config), TARGET).state
        now_s += config.period_s
    expected = {"hold": Effect.HOLD, "rest": Effect.HOLD, "relax": Effect.RELAX, "vent": Effect.VENT}
    assert (state.mode, state.pending, state.enabled) == (Mode.OFF, (expected[policy.value],), False)
    if policy is StopPolicy.REST:
        assert state.command == pytest.approx(config.rest, abs=1e-15)


@pytest.mark.parametrize("mode", list(Mode))
def test_estop_is_never_refused(config: RobotConfig, mode: Mode) -> None:
    state = transitions.estop(config, replace(running(config), mode=mode), 1.0)
    latched = Mode.FAULT if mode is Mode.FAULT else Mode.OFF
    assert (state.mode, state.pending, state.enabled) == (latched, (Effect.RELAX,), False)


@pytest.mark.parametrize("order", ["hold", "stop"])
def test_a_stop_from_a_limited_command_follows_its_plan_from_the_first_tick(
    config: RobotConfig, order: str
) -> None:
    # The command lags behind what it followed: the step from there to the plan is no pace of the plan.
    period_s, travelled = config.period_s, tuple(0.8 * each.change for each in config.limits)
    here = running(config)
    ahead = tuple(value + 40.0 * each.change for value, each in zip(here.command, config.limits, strict=True))
    state = replace(here, increments=travelled, reference=ahead)
    if order == "hold":
        state = transitions.hold(config, state, 1.0)
    else:
        state = transitions.stop(config, state, StopPolicy.REST, 1.0)
    plan = state.motion
    assert plan is not None
    for number in range(5):
        out = tick(config, state, 1.0 + number * period_s, sampled(config), None)
        assert out.state.command == plan.at((number + 1) * period_s)[0]
        assert not any(out.limits)
        state = out.state


def test_a_command_beside_its_motion_is_marked_until_it_is_back(config: RobotConfig) -> None:
    still = (0.0, 0.0)
    start = running(config).command
    goal = tuple(value - 0.02 for value in start)
    plan = Approach(start, still, goal, config.velocity, config.acceleration, config.jerk)
    period_s, number = config.period_s, 40
    reference, speed = plan.at(number * period_s)
    ahead = tuple(value - 3.0 * each.change for value, each in zip(reference, config.limits, strict=True))
    step = tuple(each * period_s for each in speed)
    state = replace(
        running(config), mode=Mode.APPROACH, goto=Target(actuation=goal), motion=plan, motion_s=0.0,
        command=ahead, increments=step, reference=reference,
    )  # fmt: skip
    marked = []
    for tick_number in range(number + 1, number + 15):
        out = tick(config, state, tick_number * period_s, sampled(config), None)
        beside = out.state.command != plan.at(tick_number * period_s)[0]
        assert any(out.limits) == beside
        marked.append(beside)
        state = out.state
    assert marked[0]
    assert not marked[-1]


@pytest.mark.parametrize(("waited_s", "mode"), [(1.9, Mode.CONNECTING), (2.1, Mode.FAULT)])
def test_a_first_sample_is_waited_for_two_seconds_from_connecting(
    config: RobotConfig, waited_s: float, mode: Mode
) -> None:
    state = RobotState(mode=Mode.CONNECTING, since_s=10.0)
    first, second = sampled(config)
    samples = (first, replace(second, valid=False))
    after = next_arming(config, state, 10.0 + waited_s, samples, None)
    assert after.mode is mode
    silent = f"no valid sample of {config.axes[1]} within 2 s"
    assert after.message == (silent if mode is Mode.FAULT else "")
    assert (after.fault is Fault.NO_SAMPLE) == (mode is Mode.FAULT)


def test_recovering_from_a_fault_enables_the_devices_anew(config: RobotConfig) -> None:
    fault = RobotState(Mode.FAULT, fault=Fault.OUTSIDE_LIMITS, message="far", enabled=True, misses=(3, 0))
    after = fault_exits.recover(config, fault, 5.0)
    assert (after.fault, after.message, after.misses) == (Fault.NONE, "", (0, 0))
    assert not after.enabled
    assert after.arm_requested
    assert after.recovering
