"""Robot-file keys of a pressure regulator, or of a pair of valves, on a Due board."""

from __future__ import annotations

import itertools
from typing import Annotated, Final, Literal

from pydantic import Field

from contid.robot_file.base import NonNegative, Positive, Strict
from contid_drivers.due.motor_options import PIN_MV, ROUNDING, PinMillivolt

#: Calibration points of a regulator the board can hold.
MAX_CALIBRATION_POINTS: Final = 8


class ValvePair(Strict):
    """An inlet and an outlet valve, both on or off, at one chamber with a pressure sensor.

    Attributes:
        outlet: ``normally_open`` (without power the chamber vents) or ``normally_closed`` (it keeps its
            pressure while the board restarts; the axis needs ``start_state: hold``).
        valve_ms: longest time in which a valve opens or shuts; rather too long than too short.
        least_ms: shortest pulse of a valve.
        band_bar: error of the pressure without a pulse.
    """

    outlet: Literal["normally_open", "normally_closed"]
    valve_ms: int = Field(default=10, ge=1, le=500)
    least_ms: int = Field(default=5, ge=1, le=500)
    band_bar: Positive = 0.01


class RegulatorOptions(Strict):
    """Keys of an axis on a channel ``p0`` .. ``p5``.

    Attributes:
        calibration: rows ``[duty_percent, bar]``, both rising; the regulator's command, measured.
        valves: a pair of valves in place of a regulator, without ``calibration``.
        readback: two rows ``[mV at the analogue pin, bar]``; the regulator's pressure output, measured.
        ceiling_bar: limit of demands; a reading well above it vents.
        slew_bar_s: rate limit of the set-point.
        vent_bar_s: rate at which it falls to zero in the safe state ``vent``.
        wire_break_mv: a lower signal means a broken wire (540 for 4-20 mA over 150 ohm: 3.6 mA); 0 for
            signals that start at 0 V, where a break shows as a leak.
        leak_bar: a reading this far below the set-point for ``leak_ms`` is a leak; below a set-point of twice
            this value, half the set-point (at least a quarter of ``leak_bar``).
        leak_ms: see ``leak_bar``.
        over_bar: a reading this far above the set-point, or above zero at rest, that does not fall within
            ``over_ms`` is a fault.
        over_ms: see ``over_bar``.
        lag_ms: time constant with which the reading follows a step, measured at the chamber. A reading that
            stands still (within an eighth of ``leak_bar``) while a set-point with this lag moves by
            ``leak_bar`` is a fault.
        trim_bar: limit of the correction by an outer loop on the reading, and never more than half the
            set-point; 0 switches the loop off. It rests while the reading is outside ``leak_bar`` or
            ``over_bar``.
        trim_per_s: gain of that loop, per second and bar of error.
    """

    calibration: tuple[tuple[float, float], ...] | None = None
    valves: ValvePair | None = None
    readback: tuple[tuple[PinMillivolt, float], tuple[PinMillivolt, float]] | None = None
    ceiling_bar: Annotated[float, Field(gt=0, le=20)] | None = None
    slew_bar_s: Annotated[float, Field(gt=0, le=100)] = 2.0
    vent_bar_s: Annotated[float, Field(gt=0, le=100)] = 2.0
    wire_break_mv: PinMillivolt = 0.0
    leak_bar: Positive = 0.2
    leak_ms: int = Field(default=500, ge=10, le=10_000)
    over_bar: Positive = 0.2
    over_ms: int = Field(default=1000, ge=10, le=10_000)
    lag_ms: int = Field(default=150, ge=1, le=10_000)
    trim_bar: NonNegative = 0.0
    trim_per_s: NonNegative = 2.0

    def check_calibration(self) -> None:
        """Raise ValueError for rows that do not rise, or do not reach the ceiling."""
        assert self.calibration is not None
        assert self.ceiling_bar is not None
        rows = self.calibration
        if not 2 <= len(rows) <= MAX_CALIBRATION_POINTS:
            raise ValueError(f"calibration has 2 to {MAX_CALIBRATION_POINTS} rows, got {len(rows)}")
        if not all(0.0 <= duty <= 100.0 for duty, _ in rows):
            raise ValueError("calibration: duty_percent is 0 to 100")
        if not all(a[0] < b[0] and a[1] < b[1] for a, b in itertools.pairwise(rows)):
            raise ValueError("calibration: duty_percent and bar must both rise from row to row")
        if not rows[0][1] <= 0.0 <= self.ceiling_bar <= rows[-1][1]:
            raise ValueError(
                f"calibration must reach from 0 bar to ceiling_bar {self.ceiling_bar:g}, "
                f"it covers {rows[0][1]:g} to {rows[-1][1]:g}"
            )

    def check_readback(self) -> None:
        """Raise ValueError for rows that do not rise, and for a ceiling or broken wire that is never read."""
        assert self.readback is not None
        assert self.ceiling_bar is not None
        (low_mv, low_bar), (high_mv, high_bar) = self.readback
        if not (low_mv < high_mv and low_bar < high_bar):
            raise ValueError("readback: mV and bar must both rise from the first row to the second")
        bar_per_mv = (high_bar - low_bar) / (high_mv - low_mv)
        top_bar, zero_mv = high_bar + (PIN_MV - high_mv) * bar_per_mv, low_mv - low_bar / bar_per_mv
        if self.ceiling_bar > top_bar * (1.0 + ROUNDING):
            raise ValueError(
                f"ceiling_bar {self.ceiling_bar:g} is never read: "
                f"readback ends at {top_bar:.4g} bar (3300 mV)"
            )
        if self.wire_break_mv and self.wire_break_mv >= zero_mv:
            raise ValueError(
                f"wire_break_mv {self.wire_break_mv:g} must be below {zero_mv:.4g} mV, "
                "which readback has at 0 bar"
            )
