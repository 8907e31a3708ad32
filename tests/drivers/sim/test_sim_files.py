"""Simulated buses in robot files: written out, and as the stand-in under --mock."""

from __future__ import annotations

from typing import Any, cast

import pytest

from contid.errors import BadInputError, ContidError
from contid.hal import AxisOnBus, DeviceKind, load_driver
from contid.robot_file.load import load_robot_file, parse_robot_file, with_mock
from contid_drivers.sim.options import FaultKind, ScheduledFault, SimBusOptions

BUS = """driver: dynamixel
    port: /dev/serial/by-id/usb-FTDI_USB__-__Serial_Converter_XXXXXXXX-if00-port0
    baud: 1000000"""


class Still:
    def now(self):
        return 0.0

    def sleep(self, seconds):
        raise AssertionError("nothing here may wait")


def _left(fault):
    return f"faults: [{{at_s: 1.0, axis: finger.left, kind: {fault}}}]"


@pytest.fixture
def finger(configs):
    """finger.yaml on a simulated bus with a campaign of faults."""

    def text(bus="seed: 7", left=""):
        source = (configs / "finger.yaml").read_text()
        assert BUS in source
        source = source.replace(BUS, f"driver: sim\n    {bus}")
        return source.replace("id: 1,", f"device: servo, {left}").replace("id: 2,", "device: servo,")

    return text


def test_a_file_may_ask_for_simulation(finger):
    fault = "faults: [{at_s: 1.0, axis: finger.left, kind: silent, for_s: 0.2}]"
    loaded = parse_robot_file(finger(fault, left="start_deg: 300,"), "x.yaml")
    wiring: Any = loaded.buses["servos"]
    assert wiring.options.faults[0].for_s == 0.2
    assert [axis for axis, _ in wiring.axes] == ["finger.left", "finger.right"]
    assert wiring.axes[0][1].start == pytest.approx(5.2359877559)
    assert with_mock(loaded).buses == loaded.buses


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"bus": "faults: [{at_s: 1.0, kind: silent}]"}, "kind silent needs axis"),
        ({"bus": "faults: [{at_s: 1.0, kind: lost, axis: finger.left}]"}, "takes no axis"),
        ({"bus": _left("silent, delay_ms: 5")}, "kind silent takes no delay_ms"),
        ({"bus": _left("leak, by_deg: 5, share: 0.5")}, "kind leak takes no by_deg; allowed: share"),
        ({"bus": _left("jump")}, "kind jump needs by_deg for a shaft, or by_bar for a regulator"),
        ({"bus": _left("play, by_deg: 5, by_bar: 1")}, "kind play needs by_deg for a shaft, or by_bar"),
        ({"bus": _left("play, by_deg: -5")}, "kind play needs a size above 0"),
        ({"bus": _left("swapped, other: finger.left")}, "kind swapped needs another axis"),
        ({"bus": "watchdog_ms: 1"}, "watchdog_ms"),
        ({"left": "ceiling_bar: 2,"}, "a simulated servo has no ceiling_bar"),
        ({"left": "on_watchdog: vent,"}, "cannot vent"),
    ],
)
def test_invalid_keys_are_refused_with_their_location(finger, keys, message):
    with pytest.raises(BadInputError, match=message):
        parse_robot_file(finger(**keys), "x.yaml")


def test_a_fault_of_an_unknown_axis_is_refused_before_anything_is_opened(finger):
    wiring = parse_robot_file(finger("faults: [{at_s: 1, axis: hand.left, kind: stale}]"), "x.yaml").buses[
        "servos"
    ]
    axes = [AxisOnBus(name, options) for name, options in wiring.axes]
    with pytest.raises(ContidError, match=r"hand\.left: no such axis .* finger\.left, finger\.right"):
        load_driver("sim").open_bus("servos", wiring.options, axes, Still())


@pytest.mark.parametrize(
    ("device", "size", "message"),
    [
        (DeviceKind.SERVO, {"by_bar": 0.1}, r"^r\.a: a jump of a servo has by_deg, not by_bar"),
        (DeviceKind.REGULATOR, {"by_deg": 20.0}, r"^r\.a: a jump of a regulator has by_bar, not by_deg"),
    ],
)
def test_a_size_in_the_unit_of_another_device_is_refused(device, size, message):
    """0.1 bar are 10 000 of the unit in which a servo's angle is kept; 20 deg are a third of a pascal."""
    driver = load_driver("sim")
    axes = [AxisOnBus("r.a", driver.axis_options(device=device))]
    fault = ScheduledFault(at_s=1.0, kind=FaultKind.JUMP, axis="r.a", **size)
    with pytest.raises(ContidError, match=message):
        driver.open_bus("b", SimBusOptions(faults=(fault,)), axes, Still())


@pytest.mark.parametrize("name", ["finger", "hand", "trirack"])
def test_every_shipped_robot_has_simulated_twins(configs, name):
    loaded = load_robot_file(configs / f"{name}.yaml")
    mock = with_mock(loaded)
    for bus, wiring in cast("dict[str, Any]", mock.buses).items():
        assert wiring.driver == "sim"
        assert isinstance(wiring.options, SimBusOptions)
        kinds = [options.device for _, options in wiring.axes]
        real = load_driver(loaded.buses[bus].driver)
        assert kinds == [real.kind(options) for _, options in loaded.buses[bus].axes]
        assert [axis for axis, _ in wiring.axes] == [axis for axis, _ in loaded.buses[bus].axes]


@pytest.mark.parametrize(
    ("device", "travel", "start"),
    [
        (DeviceKind.SERVO, (1.0, 3.0), 2.0),
        (DeviceKind.MOTOR, None, 0.0),
        (DeviceKind.REGULATOR, (0.0, 1e5), 0.0),
        (DeviceKind.REGULATOR, (2e4, 1e5), 2e4),
    ],
)
def test_where_an_axis_starts(device, travel, start):
    driver = load_driver("sim")
    options = driver.axis_options(device=device)
    bus = driver.open_bus("b", SimBusOptions(), [AxisOnBus("r.a", options, travel)], Still())
    bus.open()
    assert bus.exchange({})["r.a"].value == pytest.approx(start, abs=2e-3 if device != "regulator" else 2e3)
