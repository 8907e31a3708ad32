"""The machine of an emulated servo: shaft, supply, watchdog and faults in time, behind its register table.

It has no clock: `advance` moves it to a given time, virtual in tests, real on the wire.
"""

from __future__ import annotations

import math
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_emulate.dynamixel.motion import ShaftMotion
from contid_emulate.dynamixel.table import ControlTable

BOOT_S: Final = 0.1
#: Current of a model without current registers at full load [mA].
LOAD_FULL_MA: Final = 1400
#: Longest step of the motion; the watchdog is checked in every step.
STEP_S: Final = 0.002
#: Operating modes in which the emulated motor moves; in the others it stands still.
_CURRENT_BASED_MODE: Final = reg.MODE_NUMBERS["current_based_position"]
_POSITION_MODES: Final = (3, reg.MODE_NUMBERS["extended_position"], _CURRENT_BASED_MODE)
_PWM_MODE: Final = 16
#: Bit of Startup Configuration: torque on at power-up.
_TORQUE_ON: Final = 0x01
#: Bit of Hardware Error Status.
_OVERLOAD: Final = 0x20


class ServoMachine(ControlTable):
    """What a servo does by itself; base of `contid_emulate.dynamixel.servo.Servo`."""

    def __init__(
        self,
        device: int,
        *,
        baud: int = 1000000,
        firmware: int = 52,
        model: int = 1200,
        position_ticks: float = 2048.0,
        stops_ticks: tuple[float, float] = (-math.inf, math.inf),
    ) -> None:
        super().__init__(model, firmware)
        self.motion = ShaftMotion(position_ticks, stops_ticks)
        #: The stops of a jammed shaft while it was free.
        self._free_stops: tuple[float, float] | None = None
        #: Time that it was advanced to [s], as of the next three.
        self.now = 0.0
        #: End of its last start; before it, it does not answer.
        self.booted_at = 0.0
        #: Last time at which the Bus Watchdog was fed.
        self.fed_at = 0.0
        #: Last time at which the Bus Watchdog tripped.
        self.stopped_at = 0.0
        #: Goal [ticks of the encoder] that a tripped Bus Watchdog has set; None unless that was under torque.
        self.tripped_goal: float | None = None
        #: Address and data of a REG WRITE that awaits its ACTION.
        self.registered: tuple[int, bytes] | None = None
        #: Whole turns the servo forgot when it lost power.
        self.forgotten_ticks = 0
        self.supply_decivolt = round(self.model.supply_v * 10)
        #: Position [ticks] that a broken encoder reports, None for the true one.
        self.frozen: int | None = None
        #: A hand turns the shaft: its speed [ticks/s], and until when.
        self.hand_ticks_s, self.hand_until = 0.0, 0.0
        code = next(code for code, rate in reg.BAUD_CODES.items() if rate == baud)
        for register, value in ((reg.ID, device), (reg.BAUD, code), (reg.FIRMWARE, firmware)):
            self.put(register, value)
        self.put(reg.MODEL_NUMBER, model)
        self._power_up()

    @property
    def position_ticks(self) -> float:
        """True position of the shaft, over all turns."""
        return self.motion.position

    @property
    def answers(self) -> bool:
        """False while it boots."""
        return self.now >= self.booted_at

    def read(self, address: int, size: int) -> bytes:
        """Bytes of the control table now."""
        self._report()
        return super().read(address, size)

    def reboot(self) -> None:
        """REBOOT, or a brown-out: RAM and turn count are lost, torque is off, no answers during the start."""
        self.booted_at = self.now + BOOT_S
        self._power_up()

    def _power_up(self) -> None:
        for register in self.table:
            if not register.eeprom:
                self.put(register, register.default)
        self.motion.release()
        self.registered = self.tripped_goal = None
        self.reset_control()
        self.forget_turns()
        self.put(reg.GOAL_POSITION, 0)
        if self.get(reg.STARTUP) & _TORQUE_ON:
            self.put(reg.GOAL_POSITION, self.present())
            self.put(reg.TORQUE_ENABLE, 1)

    def reset_control(self) -> None:
        """Gains, profile and goals as after a change of mode."""
        for gain in reg.GAINS:
            self.put(gain, self.by_name[gain.name].default)
        for register in (reg.PROFILE_VELOCITY, reg.PROFILE_ACCELERATION, reg.GOAL_VELOCITY):
            self.put(register, 0)
        self.put(reg.GOAL_PWM, self.get(reg.PWM_LIMIT))
        if self.model.ma_per_unit:
            self.put(reg.GOAL_CURRENT, self.get(reg.CURRENT_LIMIT))

    def forget_turns(self) -> None:
        """Count from the turn of the shaft again."""
        self.forgotten_ticks = math.floor(self.motion.position / reg.TICKS_PER_REV) * reg.TICKS_PER_REV

    def count_offset(self) -> int:
        """Reported position minus real position [ticks]."""
        return self.get(reg.HOMING_OFFSET) - self.forgotten_ticks

    def advance(self, now: float) -> None:
        """Move on to ``now`` [s]."""
        while self.now < now:
            step = min(STEP_S, now - self.now)
            self.now += step
            self._watch()
            mode = self.memory[reg.OPERATING_MODE.address]
            if self.torque and mode == _PWM_MODE:
                share = 0.0 if self.tripped else self.get(reg.GOAL_PWM) / reg.PWM_LIMIT.default
                self.motion.drive(share, self.supply_decivolt / 10.0 / self.model.supply_v, step)
            elif self.torque and mode in _POSITION_MODES:
                self._limits()
                self.motion.step(step)
                if self.motion.overloaded:
                    self.fail(_OVERLOAD)
            elif self.motion.velocity:
                self.motion.release()
            by_hand = self.now <= self.hand_until
            if by_hand and not self.torque:
                self.motion.turn(self.hand_ticks_s * step)
            if now - self.now > 1.0 and not self.motion.velocity and not by_hand:
                # Not advanced for a long time and nothing moves: skip ahead.
                self.now = now - 1.0

    def _watch(self) -> None:
        armed = self.memory[reg.BUS_WATCHDOG.address]
        if not self.torque or not 1 <= armed <= reg.BUS_WATCHDOG.high:
            return
        if self.now - self.fed_at > armed * reg.WATCHDOG_MS_PER_UNIT / 1e3:
            self.trip()

    def trip(self) -> None:
        """Bus Watchdog trip: stop, and ignore goals until 0 is written.

        The goal becomes the position of the encoder plus Homing Offset: a servo with an offset moves by it.
        This follows a fault of real firmware (DynamixelSDK issue 584, reported in extended position mode). By
        that report the real motor does not stop; the emulated one moves once. The driver writes Homing Offset
        0 before it arms a servo.
        """
        self.put(reg.BUS_WATCHDOG, reg.WATCHDOG_TRIPPED)
        self.stopped_at = self.now
        if self.torque:
            self.motion.velocity = 0.0
            self.tripped_goal = self.motion.seen + self.get(reg.HOMING_OFFSET)
            self.motion.goal = self.tripped_goal

    def fail(self, bits: int) -> None:
        """Hardware error; those in the shutdown mask drop the torque."""
        self.put(reg.HARDWARE_ERROR, self.get(reg.HARDWARE_ERROR) | bits)
        if bits & self.get(reg.SHUTDOWN):
            self.put(reg.TORQUE_ENABLE, 0)
            self.motion.release()

    def _limits(self) -> None:
        ticks_per_unit = reg.RAD_S_PER_UNIT / reg.RAD_PER_TICK
        profile = self.get(reg.PROFILE_VELOCITY) or self.get(reg.VELOCITY_LIMIT)
        acceleration = self.get(reg.PROFILE_ACCELERATION) * reg.DEG_S2_PER_UNIT * reg.TICKS_PER_DEG
        unit = self.model.ma_per_unit
        current = self.get(reg.CURRENT_LIMIT) if unit else LOAD_FULL_MA
        if self.memory[reg.OPERATING_MODE.address] == _CURRENT_BASED_MODE:
            current = min(current, abs(self.get(reg.GOAL_CURRENT)))
        self.motion.limit(profile * ticks_per_unit, acceleration, current * (unit or 1.0))

    def jam(self, on: bool) -> None:
        """Block the shaft where it is, or release it."""
        motion = self.motion
        if on and self._free_stops is None:
            self._free_stops, motion.stops = motion.stops, (motion.position, motion.position)
        elif not on and self._free_stops is not None:
            motion.stops, self._free_stops = self._free_stops, None

    def push(self, ticks: float, seconds: float) -> None:
        """Turn the shaft from outside, without torque at constant speed."""
        self.hand_ticks_s, self.hand_until = ticks / max(seconds, STEP_S), self.now + max(seconds, STEP_S)

    def present(self) -> int:
        """Present Position now [ticks]."""
        if self.frozen is not None:
            return self.frozen
        return round(self.motion.seen) + self.count_offset()

    def _report(self) -> None:
        """Bring the read-only registers up to date."""
        motion = self.motion
        current_ma = motion.current
        velocity = int(motion.velocity * reg.RAD_PER_TICK / reg.RAD_S_PER_UNIT)
        if self.frozen is not None and self.torque:
            # The position loop of the servo sees the same error for ever.
            current_ma = motion.pushing(self.get(reg.GOAL_POSITION) - self.frozen)
            velocity = 0
        # A model without current registers reports its load, 0.1 %, at the same address.
        current = int(current_ma / (self.model.ma_per_unit or LOAD_FULL_MA / 1e3))
        self.put(reg.PRESENT_CURRENT, current)
        self.put(reg.PRESENT_VELOCITY, velocity)
        self.put(reg.PRESENT_POSITION, self.present())
        self.put(reg.PRESENT_VOLTAGE, self.supply_decivolt)
        self.put(reg.MOVING, 1 if velocity else 0)
        self.put(reg.REALTIME_TICK, int((self.now - self.booted_at) * 1e3) % reg.REALTIME_TICKS)
