"""What a bring-up of servos depends on: their cables, and the servos that answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing

from contid.hal import AxisOnBus
from contid.hal.pulses import ProvenDevice
from contid.kit.serial_ports import find_port
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.axis import Axis
from contid_drivers.dynamixel.checks import identity
from contid_drivers.dynamixel.client import ServoClient
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions
from contid_drivers.dynamixel.port import ServoPort


def servo_device(client: ServoClient, axis: Axis) -> ProvenDevice:
    """The servo of an axis: its model and mark, its firmware."""
    mark = identity.read_mark(client, axis.device)
    return ProvenDevice(f"{axis.options.model} {mark}".rstrip(), str(client.read(axis.device, reg.FIRMWARE)))


def wiring(options: DynamixelBusOptions, axis: DynamixelAxisOptions) -> Mapping[str, object]:
    """The options of an axis and its bus that a change of wiring would change."""
    return {"port": options.port} | axis.model_dump(mode="json", include={"id", "model"})


def devices(name: str, options: DynamixelBusOptions, axes: Sequence[AxisOnBus]) -> Mapping[str, ProvenDevice]:
    """The servo of each axis that answers now (`contid.hal.pulses.Proves.devices`)."""
    states = [Axis.of(axis, options) for axis in axes]
    path = find_port(name, options.port)
    with closing(ServoPort(name, path, options.baud, options.usb_latency_ms / 1e3)) as port:
        client = ServoClient(name, port)
        return {a.name: servo_device(client, a) for a in states if client.ping(a.device) is not None}
