"""Which value of a configuration a board refused, from the place that its answer names."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from contid.hal import AxisOnBus, DeviceKind
from contid_drivers.due.wiring import MOTOR_FIELDS, REGULATOR_FIELDS, TENSION_FIELDS, axis_options

#: Bytes of a configure message before the configuration (header, checksum), and of that before its channels
#: (role, watchdog, number of channels).
_HEAD: Final = 3 + 2
_BOARD: Final = 1 + 2 + 1


def refused_value(blob: bytes, axes: Sequence[AxisOnBus], detail: int) -> str:
    """``ROBOT.AXIS: FIELD VALUE``, in the units of the board; "" when the place is in no channel.

    Args:
        blob: the configuration, as `contid_drivers.due.wiring.board_config` makes it.
        axes: its axes.
        detail: of the refusal: bytes of the message up to the end of the value.
    """
    at, end = _BOARD, detail - _HEAD
    for axis in sorted(axes, key=lambda one: axis_options(one).number):
        options = axis_options(axis)
        motor = options.kind is DeviceKind.MOTOR
        tension = TENSION_FIELDS if options.tension is not None else {}
        for name, code in [*(MOTOR_FIELDS if motor else REGULATOR_FIELDS).items(), *tension.items()]:
            (value,) = struct.unpack_from(f"<{code}", blob, at)
            at += struct.calcsize(f"<{code}")
            if at >= end:
                return f"{axis.name}: {name} {value}"
        rows = "<BHHi" if options.valves is not None else "<" + "Hi" * len(options.calibration or ())
        at += 0 if motor else struct.calcsize(rows)
        if at >= end:
            return f"{axis.name}: {'valves' if options.valves is not None else 'calibration'}"
    return ""
