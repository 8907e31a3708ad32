"""Orders between two ticks, and faults while a robot stops: no rest of the devices is lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from contid.control.engine import messages as msg
from contid.control.engine.events import RunEvent
from contid.control.engine.events.buses import BusAnswered
from contid.control.engine.events.robots import OrderRefused
from contid.control.engine.virtual import VirtualProcess
from contid.control.tick import transitions
from contid.control.tick.faults import Fault
from contid.control.tick.state import RobotState
from contid.control.tick.supervisor import Mode
from contid.errors import DeviceLostError
from contid.hal import Rest, Sample
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import parse_robot_file
from contid_drivers.sim.bus import SimBus
from tests.support.fingers import circle, fingers, load

AT, LONG = 200, 320
LOST = "faults: [{at_s: 1.0, kind: lost, for_s: 9}]"


class Seen:
    """What the devices were asked for, and the rest of a run."""

    def __init__(self) -> None:
        self.events: list[RunEvent] = []
        self.powered: set[str] = set()
        self.state = RobotState()

    def write(self, values: list[float]) -> None: ...

    def event(self, event: RunEvent) -> None:
        self.events.append(event)

    def done(self, since: int = AT) -> list[str]:
        """Requests that a bus carried out from a tick on."""
        answers = [each for each in self.events if isinstance(each, BusAnswered) and each.tick >= since]
        return [effect for each in answers for _, effect in each.done]


def run(
    orders: Mapping[int, Sequence[msg.Message]],
    fails_at: int | None = None,
    on_fault: str = "hold",
    text: str = "",
    ticks: int = LONG,
) -> Seen:
    """A finger that is armed at once and follows a circle."""
    seen = Seen()
    loaded = parse_robot_file(text, "two.yaml") if text else load(1, on_fault=on_fault)
    source = None if text else circle(loaded, period_s=3.0)
    process = VirtualProcess(loaded, 200.0, seen, trajectory=source, attended=True)
    process.engine.arm()
    while process.tick < ticks and not process.engine.finished:
        process.begin()
        if process.tick == fails_at:
            process.engine.robots.fail(0, Fault.INTERNAL, "made by the test", process.tick / 200.0)
        for message in orders.get(process.tick, ()):
            process.engine.obey(message, process.tick)
        process.turn()
    seen.state = process.engine.robots.states[0]
    for bus in process.buses.values():
        assert isinstance(bus, SimBus)
        seen.powered |= {axis for axis, device in bus.devices.items() if device.on}
    process.close()
    return seen


@pytest.mark.parametrize(
    ("after", "mode", "asked"),
    [
        ([msg.ClearFault()], Mode.READY, ["RELAX", "CLEAR"]),
        ([msg.Stop(policy=StopPolicy.HOLD)], Mode.FAULT, ["RELAX"]),
        ([msg.Estop()], Mode.FAULT, ["RELAX"]),
        ([msg.Stop(policy=StopPolicy.VENT), msg.ClearFault()], Mode.READY, ["RELAX", "VENT", "CLEAR"]),
    ],
)
@pytest.mark.parametrize("first", [msg.Estop(), msg.Stop(policy=StopPolicy.RELAX)])
def test_an_order_after_a_stop_of_the_same_tick_does_not_replace_its_rest(
    first: msg.Message, after: list[msg.Message], mode: Mode, asked: list[str]
) -> None:
    seen = run({AT: [first, *after]}, fails_at=120)
    assert (seen.state.mode, seen.done(), seen.powered) == (mode, asked, set())


def test_an_emergency_stop_drops_what_was_to_be_cleared_before_it() -> None:
    seen = run({AT: [msg.ClearFault(), msg.Estop()]}, fails_at=120)
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.FAULT, ["RELAX"], set())


def test_a_robot_armed_again_in_the_tick_of_its_emergency_stop_is_relaxed_first() -> None:
    seen = run({AT: [msg.Estop(), msg.Resume()]})
    assert (seen.state.mode, seen.done()) == (Mode.RUN, ["RELAX", "ENABLE"])


@pytest.mark.parametrize("later", [0, 1, 40])
@pytest.mark.parametrize("who", [None, ("f0",)])
def test_an_order_to_follow_does_not_arm_what_was_stopped_before_it(
    who: tuple[str, ...] | None, later: int
) -> None:
    orders: dict[int, list[msg.Message]] = {AT: [msg.Estop()]}
    orders.setdefault(AT + later, []).append(msg.Follow(who))
    seen = run(orders)
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.OFF, ["RELAX"], set())


def test_an_order_to_follow_ends_a_hold() -> None:
    seen = run({AT: [msg.Hold()], AT + 40: [msg.Follow()]})
    assert (seen.state.mode, seen.done()) == (Mode.RUN, [])


@pytest.mark.parametrize("later", [0, 1, 2, 5])
def test_a_fault_while_a_robot_stops_does_not_forget_the_stop(later: int) -> None:
    seen = run({AT: [msg.Stop(policy=StopPolicy.RELAX)]}, fails_at=AT + later)
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.FAULT, ["RELAX"], set())


def test_a_stop_does_not_ask_devices_at_rest_to_hold() -> None:
    seen = run({AT: [msg.Estop()], AT + 50: [msg.Stop(policy=StopPolicy.HOLD)]}, fails_at=120)
    assert (seen.state.mode, seen.done()) == (Mode.FAULT, ["RELAX"])


@pytest.mark.parametrize("on_fault", ["hold", "relax"])
def test_what_a_robot_has_on_other_buses_rests_when_one_is_lost(on_fault: str) -> None:
    text = fingers(1, buses=2, options=LOST, on_fault=on_fault)
    text = text.replace("right: {bus: bus0", "right: {bus: bus1")
    seen = run({AT: []}, text=text)
    assert seen.state.fault is Fault.DEVICE_LOST
    assert seen.done() == [on_fault.upper()]
    assert "f0.right" not in seen.powered


@pytest.mark.parametrize("on_fault", ["hold", "relax"])
def test_devices_that_were_being_armed_rest_in_a_fault(on_fault: str) -> None:
    seen = run({AT: [msg.Estop(), msg.Resume()]}, fails_at=AT + 1, on_fault=on_fault)
    assert (seen.state.mode, seen.done(), seen.powered) == (
        Mode.FAULT,
        ["RELAX", "ENABLE", on_fault.upper()],
        set(),
    )


def test_a_later_stop_that_leaves_more_power_does_not_replace_one_that_runs() -> None:
    weaker: list[msg.Message] = [msg.Stop(policy=each) for each in (StopPolicy.REST, StopPolicy.HOLD)]
    seen = run({AT: [msg.Stop(policy=StopPolicy.RELAX)], AT + 2: [*weaker, msg.Finish(StopPolicy.REST)]})
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.OFF, ["RELAX"], set())
    # It stops where it was: a way to the rest pose would be longer.
    assert seen.state.command != pytest.approx((0.06, 0.06), abs=1e-3)


def stronger(seen: Seen) -> list[tuple[str, str]]:
    refused = [each for each in seen.events if isinstance(each, OrderRefused)]
    return [(each.stronger, each.message) for each in refused]


@pytest.mark.parametrize("who", [None, ("f0",)])
def test_a_stop_is_answered_by_a_stronger_one_that_goes_on(who: tuple[str, ...] | None) -> None:
    """It was ignored without a word."""
    weaker = msg.Stop(who, StopPolicy.HOLD)
    seen = run({AT: [msg.Stop(policy=StopPolicy.RELAX)], AT + 2: [weaker]})
    assert stronger(seen) == [("relax", "f0: its stop by relax goes on; hold would leave more power")]
    assert seen.done() == ["RELAX"]
    # One that is as strong, or stronger, is obeyed: there is nothing to report.
    for policy in (StopPolicy.RELAX, StopPolicy.VENT):
        assert not stronger(run({AT: [msg.Stop(policy=StopPolicy.RELAX)], AT + 2: [msg.Stop(who, policy)]}))
    held = run({AT: [msg.Stop(policy=StopPolicy.RELAX)], AT + 2: [msg.Hold(who)]})
    assert stronger(held) == [("", "f0: cannot hold while STOPPING: its stop by relax goes on")]


def test_a_hold_does_not_withdraw_a_relax_that_a_lost_bus_has_to_get() -> None:
    options = "watchdog_ms: 5000\nfaults: [{at_s: 1.0, kind: lost, for_s: 0.2}]"
    orders: dict[int, list[msg.Message]] = {
        AT + 10: [msg.Estop()],
        AT + 20: [msg.Stop(policy=StopPolicy.HOLD)],
    }
    seen = run(orders, text=fingers(1, options=options), ticks=450)
    ((policy, words),) = stronger(seen)
    assert (policy, seen.done(), seen.powered) == ("relax", ["RELAX"], set())
    assert "is sent to its devices when their bus is back" in words


def test_the_end_of_a_run_rests_a_robot_in_fault_by_its_own_policy_too() -> None:
    seen = run({AT: [msg.Finish(StopPolicy.RELAX)]}, fails_at=120)
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.FAULT, ["RELAX"], set())


@pytest.mark.parametrize("before", [0, 2])
def test_a_stop_that_runs_when_a_bus_is_lost_rests_the_other_one_by_its_policy(before: int) -> None:
    text = fingers(1, buses=2, options=LOST).replace("right: {bus: bus0", "right: {bus: bus1")
    seen = run({AT - before: [msg.Stop(policy=StopPolicy.RELAX)]}, text=text)
    assert "RELAX" in seen.done(AT - before)
    assert "f0.right" not in seen.powered


def test_a_relax_after_a_fault_while_arming_reaches_the_devices() -> None:
    orders: dict[int, list[msg.Message]] = {AT: [msg.Estop(), msg.Resume()]}
    orders[AT + 50] = [msg.Stop(policy=StopPolicy.RELAX)]
    seen = run(orders, fails_at=AT + 1)
    assert (seen.state.mode, seen.done()[-1], seen.powered) == (Mode.FAULT, "RELAX", set())


def test_an_order_to_stop_whose_model_fails_stops_and_rests_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*arguments: object) -> object:
        raise ValueError("made by the test")

    monkeypatch.setattr(transitions, "braking", fails)
    seen = run({AT: [msg.Stop(policy=StopPolicy.RELAX)]})
    assert (seen.state.mode, seen.state.fault) == (Mode.FAULT, Fault.INTERNAL)
    assert (seen.done()[-1], seen.powered) == ("RELAX", set())


@pytest.mark.parametrize("on_fault", ["hold", "relax"])
@pytest.mark.parametrize("ordered", [True, False])
def test_a_rest_that_did_not_reach_a_lost_bus_is_sent_when_it_is_back(ordered: bool, on_fault: str) -> None:
    options = "watchdog_ms: 5000\nfaults: [{at_s: 1.0, kind: lost, for_s: 0.2}]"
    text = fingers(1, options=options, on_fault=on_fault)
    seen = run({AT + 10: [msg.Estop()] if ordered else []}, text=text, ticks=450)
    assert seen.state.fault is Fault.DEVICE_LOST
    # By `hold` nothing is asked: it would close the valves of an arm that its watchdog let vent.
    relaxed = ordered or on_fault == "relax"
    assert seen.done() == ["RELAX"] * relaxed
    assert bool(seen.powered) is not relaxed


def test_an_emergency_stop_in_the_tick_of_an_internal_error_reaches_the_devices() -> None:
    loaded = load(1)
    process = VirtualProcess(loaded, 200.0, Seen(), trajectory=circle(loaded, period_s=3.0), attended=True)
    process.engine.arm()
    while process.tick < AT:
        process.begin()
        process.turn()
    process.engine.obey(msg.Estop(), process.tick)
    process.engine.exchange.abandon()
    (bus,) = process.buses.values()
    assert isinstance(bus, SimBus)
    assert not [axis for axis, device in bus.devices.items() if device.on]
    process.close()


@pytest.mark.parametrize("faulty", [False, True])
@pytest.mark.parametrize("on_host_loss", ["hold", "relax"])
def test_an_internal_error_while_a_robot_brakes_leaves_no_more_power_than_its_stop(
    faulty: bool, on_host_loss: str
) -> None:
    text = fingers(1).replace("on_host_loss: relax", f"on_host_loss: {on_host_loss}")
    loaded = parse_robot_file(text, "one.yaml")
    process = VirtualProcess(loaded, 200.0, Seen(), trajectory=circle(loaded, period_s=3.0), attended=True)
    process.engine.arm()

    while process.tick < AT:
        process.begin()
        process.turn()
    process.engine.obey(msg.Stop(policy=StopPolicy.RELAX), process.tick)
    if faulty:
        process.engine.robots.fail(0, Fault.DOES_NOT_FOLLOW, "made by the test", process.tick / 200.0)
    process.begin()
    process.turn()
    (state,) = process.engine.robots.states
    assert state.enabled, "it brakes"
    process.engine.exchange.abandon()
    (bus,) = process.buses.values()
    assert isinstance(bus, SimBus)
    assert not [axis for axis, device in bus.devices.items() if device.motion.powered]
    process.close()


def test_a_stop_that_was_overtaken_does_not_act_on_a_robot_armed_again() -> None:
    orders: dict[int, list[msg.Message]] = {
        122: [msg.Stop(policy=StopPolicy.RELAX)],
        123: [msg.Stop(policy=StopPolicy.VENT)],
        AT: [msg.ClearFault()],
        AT + 10: [msg.Resume()],
        AT + 100: [msg.Hold()],
    }
    seen = run(orders, fails_at=120)
    assert (seen.state.mode, seen.state.fault, len(seen.powered)) == (Mode.HOLD, Fault.NONE, 2)
    assert seen.done() == ["CLEAR", "ENABLE"]


def test_a_vent_of_the_same_tick_is_not_followed_by_a_relax() -> None:
    seen = run({AT: [msg.Stop(policy=StopPolicy.VENT), msg.Estop()]})
    assert (seen.state.mode, seen.done(), seen.powered) == (Mode.OFF, ["VENT"], set())


def test_a_driver_whose_rest_fails_is_not_asked_for_it_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Rest] = []

    def fails(bus: SimBus, axes: Sequence[str], rest: Rest) -> None:
        asked.append(rest)
        raise TypeError("made by the test")

    monkeypatch.setattr(SimBus, "disable", fails)
    run({AT: [msg.Estop()]})
    assert asked == [Rest.RELAX] * 2


def test_a_rest_older_than_the_arming_after_it_is_not_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = SimBus.exchange

    def lost(bus: SimBus, commands: Mapping[str, float]) -> Mapping[str, Sample]:
        if bus.devices["f0.left"].on and journal[-2:] == ["RELAX", "ENABLE"]:
            journal.append("lost")
            raise DeviceLostError(bus.name, "made by the test", "")
        return sound(bus, commands)

    journal: list[str] = []
    enable, disable = SimBus.enable, SimBus.disable

    def enabled(bus: SimBus, axes: Sequence[str]) -> None:
        journal.append("ENABLE")
        enable(bus, axes)

    def disabled(bus: SimBus, axes: Sequence[str], rest: Rest) -> None:
        journal.append(rest.name)
        disable(bus, axes, rest)

    monkeypatch.setattr(SimBus, "exchange", lost)
    monkeypatch.setattr(SimBus, "enable", enabled)
    monkeypatch.setattr(SimBus, "disable", disabled)
    run({AT: [msg.Estop(), msg.Resume()]})
    assert journal == ["ENABLE", "RELAX", "ENABLE", "lost"]
