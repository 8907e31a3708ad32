"""How fast and how late a healthy device answers its commands: by its driver, else by its kind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol, runtime_checkable

from contid.hal.bus import DeviceKind
from contid.units import BAR

if TYPE_CHECKING:
    from pydantic import BaseModel


@dataclass(frozen=True, slots=True)
class DeviceResponse:
    """The slowest healthy answer of a device.

    Attributes:
        delay_s: dead time from a command to the first motion that is read, with that of wire and adapter.
        lag_s: time constant of the first-order lag behind it.
        fastest: greatest believable speed of a reading [rad/s or Pa/s].
        top: its own limit of speed where faster commands are no mistake, because it ramps them itself
            [rad/s or Pa/s].
        overshoot_s: how far it may run ahead of its command, as a time at the speed of the command.
        effort_limit_a: greatest effort of a device that gives way to what it pushes on [A]; 0 where its limit
            is its own and not in the robot file, None for one that does not give way.
    """

    delay_s: float
    lag_s: float
    fastest: float
    top: float = math.inf
    overshoot_s: float = 0.0
    effort_limit_a: float | None = None


#: No geared servo or motor turns faster (Dynamixel XL330-M077: 383 rpm at 5 V).
_FASTEST_RAD_S: Final = 500.0 * math.tau / 60.0
#: Defaults by the kind of device. Adapters are late by up to 16 ms (FTDI's default latency timer); lags are
#: those of the simulated devices and a fifth more (a servo, a motor: twice), not measured on real ones.
#: The set-point of a motor board goes on for two intervals of its commands, which a late host lets it do.
RESPONSES: Final[dict[DeviceKind, DeviceResponse]] = {
    DeviceKind.SERVO: DeviceResponse(0.02, 0.04, _FASTEST_RAD_S),
    DeviceKind.MOTOR: DeviceResponse(0.02, 0.02, _FASTEST_RAD_S, overshoot_s=0.02),
    DeviceKind.REGULATOR: DeviceResponse(0.02, 0.06, 50.0 * BAR),
}


@runtime_checkable
class Responds(Protocol):
    """A driver that describes the response of its devices better than their kind does."""

    def device_response(self, bus: BaseModel, axis: BaseModel) -> DeviceResponse:
        """Of the device of an axis, with the options of its bus and its own."""
