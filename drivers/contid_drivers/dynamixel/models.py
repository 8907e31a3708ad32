"""Servos of the X series that contid drives: what differs between their control tables.

All have Protocol 2.0, 4096 ticks per turn and the same registers up to address 146, except the current
registers (38, 102, 126), which some lack: their register 126 is a load in 0.1 %, which is no current. The
indirect data begin at 208 or 224 (`indirect_data`). The gains after a power-up or a change of operating mode
differ as well. Sources: the e-manual page of each model (https://emanual.robotis.com/docs/en/dxl/x/MODEL/)
and the register lists in ROBOTIS-GIT/dynamixel_hardware_interface, param/dxl_model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias, get_args

ModelName: TypeAlias = Literal[
    "xl330-m077", "xl330-m288",
    "xc330-m181", "xc330-m288", "xc330-t181", "xc330-t288",
    "xl430-w250", "2xl430-w250", "xc430-w150", "xc430-w240", "2xc430-w250",
    "xm430-w210", "xm430-w350", "xm540-w150", "xm540-w270",
    "xh430-w210", "xh430-w350", "xh430-v210", "xh430-v350",
    "xh540-w150", "xh540-w270", "xh540-v150", "xh540-v270",
]  # fmt: skip

#: Firmware after which the small servos (XL330, XC330) have their indirect data at 224, as all others.
LAST_FIRMWARE_AT_208: Final = 52


class Gains(NamedTuple):
    """Gains after a power-up, and after a change of operating mode (registers 76, 78, 80, 82, 84)."""

    velocity_i: int
    velocity_p: int
    position_d: int
    position_i: int
    position_p: int


@dataclass(frozen=True, slots=True)
class ServoModel:
    """A model of servo, and what distinguishes it from others.

    Attributes:
        number: Model Number (register 0).
        ma_per_unit: unit of the current registers [mA]; None without current registers.
        current_limit: greatest Current Limit (register 38) [units]; 0 without.
        supply_v: recommended supply.
        supply_min_v, supply_max_v: limits of the supply; of models for more than 5 V the widest that the
            servo's own limits (registers 34 and 32) can be, which is more than the specification.
        gains: gains of a new servo.
    """

    name: ModelName
    number: int
    ma_per_unit: float | None
    current_limit: int
    supply_v: float
    supply_min_v: float
    supply_max_v: float
    gains: Gains

    @property
    def current_limit_ma(self) -> float:
        """Greatest current [mA]; 0 without current registers."""
        return self.current_limit * (self.ma_per_unit or 0.0)

    def indirect_data(self, firmware: int) -> int:
        """Address of the first indirect data; it depends on the firmware of the small servos."""
        small = self.name.startswith(("xl330", "xc330"))
        return 208 if small and firmware <= LAST_FIRMWARE_AT_208 else 224

    def block_start(self, firmware: int) -> int:
        """Address of the block of the exchange; 0 where one byte does not hold the supply [0.1 V]."""
        return self.indirect_data(firmware) if self.supply_max_v < 25.6 else 0

    def to_units(self, current_ma: float) -> int:
        """Register value of a current, at most the current itself.

        Raises:
            ValueError: the model has no current registers.
        """
        if self.ma_per_unit is None:
            raise ValueError(f"{self.name} has no current registers")
        return int(current_ma / self.ma_per_unit + _ROUNDING)


def _x(
    name: ModelName,
    number: int,
    unit: float | None,
    limit: int,
    supply: tuple[float, float, float],
    position_p: int,
    *,
    velocity: tuple[int, int] = (1920, 100),
    position_d: int = 0,
    position_i: int = 0,
) -> ServoModel:
    return ServoModel(
        name, number, unit, limit, *supply, Gains(*velocity, position_d, position_i, position_p)
    )


#: Of a whole number of units [units], so that a current made from one becomes the same one.
_ROUNDING: Final = 1e-6
_5V: Final = (5.0, 3.7, 6.0)
_T330: Final = (12.0, 5.5, 14.0)
_L430: Final = (11.1, 6.0, 14.0)
_C430: Final = (12.0, 6.0, 16.0)
_12V: Final = (12.0, 9.5, 16.0)
_24V: Final = (24.0, 11.0, 30.0)

MODELS: Final[tuple[ServoModel, ...]] = (
    _x("xl330-m077", 1190, 1.0, 1750, _5V, 400, velocity=(400, 40), position_i=400),
    _x("xl330-m288", 1200, 1.0, 1750, _5V, 400, velocity=(1600, 180)),
    _x("xc330-t181", 1210, 1.0, 910, _T330, 900, velocity=(1200, 40)),
    _x("xc330-t288", 1220, 1.0, 910, _T330, 900, velocity=(1200, 40)),
    _x("xc330-m181", 1230, 1.0, 2352, _5V, 1200, velocity=(1400, 100), position_d=500),
    _x("xc330-m288", 1240, 1.0, 2352, _5V, 1100, velocity=(1600, 50), position_d=500),
    _x("xl430-w250", 1060, None, 0, _L430, 640, velocity=(1000, 100), position_d=4000),
    _x("2xl430-w250", 1090, None, 0, _L430, 640, velocity=(1800, 100), position_d=2000),
    _x("xc430-w150", 1070, None, 0, _C430, 460),
    _x("xc430-w240", 1080, None, 0, _C430, 700),
    _x("2xc430-w250", 1160, None, 0, _C430, 700),
    _x("xm430-w350", 1020, 2.69, 1193, _12V, 800),
    _x("xm430-w210", 1030, 2.69, 1193, _12V, 800),
    _x("xm540-w270", 1120, 2.69, 2047, _12V, 800),
    _x("xm540-w150", 1130, 2.69, 2047, _12V, 800),
    _x("xh430-w350", 1000, 2.69, 648, _12V, 900),
    _x("xh430-w210", 1010, 2.69, 648, _12V, 900),
    _x("xh430-v350", 1040, 1.34, 689, _24V, 800),
    _x("xh430-v210", 1050, 1.34, 689, _24V, 800),
    _x("xh540-w270", 1100, 2.69, 2047, _12V, 800),
    _x("xh540-w150", 1110, 2.69, 2047, _12V, 800),
    # Older pages of the manual limit these two to 2047; the vendor corrected both (stall current 2.4 A).
    _x("xh540-v270", 1140, 2.69, 1188, _24V, 800),
    _x("xh540-v150", 1150, 2.69, 1188, _24V, 800),
)
#: Speed without load at the recommended supply [rpm], of the models whose e-manual page was read for it.
NO_LOAD_RPM: Final[dict[ModelName, float]] = {
    "xl330-m077": 383.0, "xl330-m288": 103.0, "xc330-m181": 129.0, "xc330-m288": 81.0, "2xc430-w250": 64.0,
    "xm540-w150": 53.0, "xm540-w270": 30.0, "xh540-v150": 60.0, "xh540-v270": 34.0,
}  # fmt: skip
BY_NAME: Final[dict[str, ServoModel]] = {model.name: model for model in MODELS}
BY_NUMBER: Final[dict[int, ServoModel]] = {model.number: model for model in MODELS}
assert set(BY_NAME) == set(get_args(ModelName))

#: Models that answer to Protocol 2.0 but are not supported, for messages.
OTHERS: Final[dict[int, str]] = {
    30: "mx-28", 311: "mx-64", 321: "mx-106", 350: "xl-320",
    1001: "xd430-t350", 1011: "xd430-t210", 1101: "xd540-t270", 1111: "xd540-t150",
    1170: "xw540-t260", 1180: "xw540-t140", 1270: "xw430-t333", 1310: "xw540-h260", 1700: "xc335-t332",
}  # fmt: skip
#: Models of Protocol 1.0, which their names begin with, and numbers.
PROTOCOL_1: Final = ("ax-", "rx-", "ex-", "dx-", "mx-12w")
PROTOCOL_1_NUMBERS: Final[dict[int, str]] = {
    12: "ax-12", 18: "ax-18", 300: "ax-12w", 360: "mx-12w", 29: "mx-28", 310: "mx-64", 320: "mx-106",
    10: "rx-10", 24: "rx-24f", 28: "rx-28", 64: "rx-64", 107: "ex-106+", 113: "dx-113", 116: "dx-116",
    117: "dx-117",
}  # fmt: skip


def refusal(name: str) -> str:
    """Why a model name of a robot file is refused; "" for a supported one or an unknown one."""
    low = name.lower()
    if low.startswith(PROTOCOL_1):
        return f"{name.upper()} speaks Protocol 1.0, not supported"
    if low in OTHERS.values():
        return f"{name.upper()} is not supported"
    return ""


def model_name(number: int) -> str:
    """Name of a model number."""
    if number in BY_NUMBER:
        return BY_NUMBER[number].name
    return f"{OTHERS[number]} (not supported)" if number in OTHERS else f"model {number}"
