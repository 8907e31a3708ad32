"""What the bus knows about one servo, and how a reading becomes a sample or a fault in words."""

from __future__ import annotations

from dataclasses import dataclass

from contid.hal import AxisOnBus, Sample
from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.cyclic import ServoReading
from contid_drivers.dynamixel.options import DynamixelAxisOptions, DynamixelBusOptions

RESET_IN_WORDS = "it reset itself (brown-out?); its watchdog, settings and turn count are gone"
LIMP_IN_WORDS = "its torque is off, and nobody here switched it off: does another program use this bus?"


@dataclass(slots=True)
class Axis:
    """One servo.

    Attributes:
        name: ``ROBOT.AXIS``.
        options: its part of the robot file.
        travel: device range of the robot file [rad].
        operating_mode: register 11 it is driven in.
        firmware: as found at `open`.
        return_delay_s: as found at `open`.
        enabled: commands go out.
        armed: Bus Watchdog written to it (counts of 20 ms), 0 while not armed.
        turns: whole turns added to what the servo counts; see `turns`.
        misses: exchanges in a row without an answer.
        fault: latched, in words.
        value, time_s: last good position [rad] and when it was read.
    """

    name: str
    options: DynamixelAxisOptions
    travel: tuple[float, float] | None
    operating_mode: int
    firmware: int = 0
    return_delay_s: float = 0.0
    enabled: bool = False
    armed: int = 0
    turns: int = 0
    misses: int = 0
    fault: str = ""
    value: float | None = None
    time_s: float = 0.0
    velocity: float | None = None
    effort: float | None = None
    voltage_v: float | None = None
    temperature_c: float | None = None
    hardware_error: int = 0

    @classmethod
    def of(cls, axis: AxisOnBus, bus: DynamixelBusOptions) -> Axis:
        """From the robot file."""
        options = axis.options
        assert isinstance(options, DynamixelAxisOptions)
        return cls(axis.name, options, axis.travel, reg.MODE_NUMBERS[options.mode or bus.mode])

    @property
    def device(self) -> int:
        """Id on the bus."""
        return self.options.id

    def to_rad(self, ticks: int) -> float:
        """Angle [rad] of a position the servo reports."""
        return (ticks + self.turns * reg.TICKS_PER_REV) * reg.RAD_PER_TICK

    def to_ticks(self, angle: float) -> int:
        """Nearest position of the servo for an angle [rad]."""
        return round(angle / reg.RAD_PER_TICK) - self.turns * reg.TICKS_PER_REV

    def latch(self, fault: str) -> bool:
        """Remember a fault and stop commanding the servo; True when it is news."""
        if self.fault:
            return False
        self.fault, self.enabled = fault, False
        return True

    def missed(self, time_s: float) -> Sample:
        """No answer in this exchange."""
        self.misses += 1
        return self._sample(time_s, valid=False)

    def take(self, reading: ServoReading, time_s: float) -> Sample:
        """An answer: check it, remember it, and give its sample."""
        if reading.voltage_low == 0 or reading.voltage == 0:
            # Indirect data of a servo without its mapping: none of this block is what it seems to be.
            self.latch(RESET_IN_WORDS)
            return self._sample(time_s, valid=False)
        self.misses = 0
        self._judge(reading)
        self.value = self.to_rad(reading.position)
        self.time_s = time_s
        self.velocity = reading.velocity * reg.RAD_S_PER_UNIT
        self.effort = reading.current_ma / 1e3
        if reading.voltage is not None:
            self.voltage_v = reading.voltage / 10.0
        if reading.temperature is not None:
            self.temperature_c = float(reading.temperature)
        return self._sample(time_s, valid=True)

    def _judge(self, reading: ServoReading) -> None:
        if reading.hardware_error is not None:
            self.hardware_error = reading.hardware_error
        if reading.alert or reading.hardware_error:
            message = reg.hardware_error_in_words(self.hardware_error) or "hardware alert, cause not read yet"
            if self.fault.endswith("cause not read yet"):
                self.fault = ""
            self.latch(f"hardware error: {message}; torque is off if the shutdown mask says so")
        if self.enabled and reading.torque is False and reading.watchdog == self.armed:
            self.latch(LIMP_IN_WORDS)
        if not self.armed or reading.watchdog is None or reading.watchdog == self.armed:
            return
        if reading.watchdog == reg.WATCHDOG_TRIPPED:
            waited = self.armed * reg.WATCHDOG_MS_PER_UNIT
            self.latch(f"Bus Watchdog tripped: nothing was heard for {waited} ms, it stopped")
        else:
            self.latch(RESET_IN_WORDS)

    def _sample(self, now: float, valid: bool) -> Sample:
        return Sample(
            self.value,
            self.time_s,
            valid,
            now - self.time_s if self.value is not None else 0.0,
            self.velocity,
            self.effort,
            self.temperature_c,
            self.voltage_v,
            self.fault,
        )
