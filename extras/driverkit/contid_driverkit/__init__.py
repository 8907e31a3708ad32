"""The kit for drivers: a bus to build on, serial ports, the memory of devices, and what emulators need.

docs/devices/drivers.md has a driver on it; a part is `contid.kit`, which the drivers of contid share:

* `PolledBus`, `Reading`: a bus that keeps the contract; its driver reads, sends goals and switches power;
* `SerialBus`: the same behind a serial port, found again when its adapter comes back under another name;
* `LockedPort`: a serial port with one owner; writes, reads by a deadline, leaves out the echo of adapters;
* `find_port`, `identity_of`, `usb_ports`: a port by path, glob or adapter, also when it comes back renamed;
* `examine_bus`, `port_findings`: what ``contid doctor`` finds, with the latency timer of the adapter;
* `memory_of`, `Remembered`: the devices of a bus and where they stood, kept on the host;
* `PseudoPort`, `ControlFile`: the port of an emulator, and its file of fault switches;
* `HomesByEffort`, `EffortStop`, `home_by_effort`: ``contid home`` against an end stop;
* `MonotonicClock`: of a bus that is opened outside a run;
* `defer_signals`: no signal between two orders that belong together.
"""

from contid.kit.locked_port import PORT_ERRORS, LockedPort
from contid.kit.remembered import BusMemory, Remembered, accept_remedy, memory_of
from contid.kit.serial_ports import (
    UsbIdentity,
    UsbPort,
    find_port,
    holders,
    identity_of,
    usb_ports,
)
from contid_driverkit.clock import MonotonicClock
from contid_driverkit.control_file import ControlFile
from contid_driverkit.effort_homing import EffortStop, HomesByEffort, home_by_effort
from contid_driverkit.polled_bus import PolledBus, Reading
from contid_driverkit.port_checks import examine_bus, latency_timer, owner, port_findings, port_name
from contid_driverkit.pseudo_port import PseudoPort
from contid_driverkit.serial_bus import SerialBus
from contid_driverkit.signals import defer_signals

__all__ = [
    "PORT_ERRORS",
    "BusMemory",
    "ControlFile",
    "EffortStop",
    "HomesByEffort",
    "LockedPort",
    "MonotonicClock",
    "PolledBus",
    "PseudoPort",
    "Reading",
    "Remembered",
    "SerialBus",
    "UsbIdentity",
    "UsbPort",
    "accept_remedy",
    "defer_signals",
    "examine_bus",
    "find_port",
    "holders",
    "home_by_effort",
    "identity_of",
    "latency_timer",
    "memory_of",
    "owner",
    "port_findings",
    "port_name",
    "usb_ports",
]
