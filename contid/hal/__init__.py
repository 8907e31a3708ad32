"""The hardware abstraction layer: the interface of drivers, buses and samples.

A bus carries axes. Values at this boundary are SI and belong to the *device*: the angle of an output shaft
in rad for servos and geared motors, a pressure in Pa for regulators. The transmission converts lengths to
angles, the driver angles to ticks.

Life of a bus::

    bus = driver.open_bus(name, options, axes)   # accesses no device
    bus.open()                                   # handshake; never moves, never changes torque
    bus.exchange({})                             # reads only, until every axis has a valid sample
    bus.enable(axes)                             # goal := present, then torque, then the device's watchdog
    bus.exchange({axis: value, ...})             # one tick; refreshes the watchdog
    bus.disable(axes, Rest.RELAX)                # the device's own state of rest
    bus.close()                                  # idempotent; never touches torque

Rules (`contid_driverkit.contract` checks every bus against them):

* no command is sent to an axis that is not enabled: such commands are dropped and the others are sent;
  the sample of an axis whose device disarmed itself holds the reason;
* a command that is not finite, or names no axis of the bus, is refused with `DeviceError` before anything of
  that tick is sent;
* `enable` is all or nothing, does not affect axes that are enabled already, and raises `DeviceError` for an
  axis that is silent or in a latched fault;
* after a failed read the sample keeps the last good value and its time, with ``valid=False``;
* a lost device raises `DeviceLostError` out of `exchange` within one call, and every call after that too,
  until `open` succeeds again; a single silent axis has ``valid=False`` and does not affect the others;
* only a completed `exchange` refreshes the watchdog of the devices; a trip is latched: the axis rests,
  ignores commands and reports the trip in ``fault`` (with the word ``watchdog``) until `clear_fault`, then it
  needs `enable` again;
* `open`, `disable` and `close` may be called in any state and twice.
"""

from contid.hal.bus import (
    REPORTED,
    SLACK_TENDON,
    SNAPPED_TENDON,
    AxisOnBus,
    Bus,
    Clock,
    CountsAnswers,
    DeviceKind,
    Finding,
    LimitsEffort,
    MeasuresTips,
    Rest,
    Sample,
    SimulatesBodies,
    SpooledTendon,
    TipMeasured,
)
from contid.hal.driver import (
    BUILT_IN,
    ENTRY_POINT_GROUP,
    Driver,
    Identifies,
    UnknownDriverError,
    driver_names,
    find_tool,
    load_driver,
)
from contid.hal.homing import Reference
from contid.hal.optional import (
    Commissions,
    DeviceRate,
    Diagnoses,
    Emulates,
    ExchangeTime,
    FoundDevice,
    Homed,
    Homes,
    LimitsRate,
    Paces,
    Parks,
    RefusedKey,
    RegisterValue,
    Report,
    Restricts,
    Scans,
)
from contid.hal.response import RESPONSES, DeviceResponse, Responds

__all__ = [
    "BUILT_IN",
    "ENTRY_POINT_GROUP",
    "REPORTED",
    "RESPONSES",
    "SLACK_TENDON",
    "SNAPPED_TENDON",
    "AxisOnBus",
    "Bus",
    "Clock",
    "Commissions",
    "CountsAnswers",
    "DeviceKind",
    "DeviceRate",
    "DeviceResponse",
    "Diagnoses",
    "Driver",
    "Emulates",
    "ExchangeTime",
    "Finding",
    "FoundDevice",
    "Homed",
    "Homes",
    "Identifies",
    "LimitsEffort",
    "LimitsRate",
    "MeasuresTips",
    "Paces",
    "Parks",
    "Reference",
    "RefusedKey",
    "RegisterValue",
    "Report",
    "Responds",
    "Rest",
    "Restricts",
    "Sample",
    "Scans",
    "SimulatesBodies",
    "SpooledTendon",
    "TipMeasured",
    "UnknownDriverError",
    "driver_names",
    "find_tool",
    "load_driver",
]
