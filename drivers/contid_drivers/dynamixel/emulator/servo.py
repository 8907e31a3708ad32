"""One emulated XL330: a register table, the rules of writing to it, its motion and its faults.

It has no clock: `advance` moves it to a given time, virtual in tests, real on the wire. It reproduces the
hazards of the real servo: goals are kept while torque is off, so torque on jumps unless the goal was set
first; the turn count is lost at a reboot, in position mode and by CLEAR; a tripped Bus Watchdog ignores goals
until 0 is written, and with a Homing Offset it moves the motor when it trips (DynamixelSDK issue 584).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.emulator.motion import ShaftMotion
from contid_drivers.dynamixel.emulator.table import ControlTable
from contid_drivers.dynamixel.packets import StatusError
from contid_drivers.dynamixel.registers import Register

BOOT_S: Final = 0.1
#: Current of a model without current registers at full load [mA].
LOAD_FULL_MA: Final = 1400
#: Longest step of the motion; the watchdog is checked in every step.
STEP_S: Final = 0.002
_EXTENDED_MODES: Final = (4, 5)
#: Position mode: entering it, and torque on in it, reduce Present Position to one turn (register 132).
_ONE_TURN_MODE: Final = 3
#: Modes in which the emulated motor moves; in the others it stands still.
_POSITION_MODES: Final = (3, 4, 5)
_CLEAR_MULTI_TURN: Final = b"\x01\x44\x58\x4c\x22"


@dataclass(slots=True)
class Registered:
    """A REG WRITE awaiting its ACTION."""

    address: int
    data: bytes


class Servo(ControlTable):
    """An emulated servo."""

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
        self.now = 0.0
        self.booted_at = 0.0
        self.fed_at = 0.0
        self.stopped_at = 0.0
        self.tripped_goal: float | None = None
        self.registered: Registered | None = None
        #: Whole turns the servo forgot when it lost power.
        self.forgotten_ticks = 0
        self.supply_decivolt = round(self.model.supply_v * 10)
        #: Position [ticks] that a broken encoder reports, None for the true one.
        self.frozen: int | None = None
        #: A hand turns the shaft: its speed [ticks/s], and until when.
        self.hand_ticks_s, self.hand_until = 0.0, 0.0
        #: Hardware error that returns after every reboot until it is set to 0.
        self.cause = 0
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
    def seen_ticks(self) -> float:
        """Position of the shaft, over all turns, as its encoder has it: a frozen one stays behind."""
        return self.motion.position if self.frozen is None else self.frozen - self._count_offset()

    @property
    def answers(self) -> bool:
        """False while it boots."""
        return self.now >= self.booted_at

    def read(self, address: int, size: int) -> bytes:
        """Bytes of the control table now."""
        self._report()
        return super().read(address, size)

    def write(self, address: int, data: bytes) -> StatusError:
        """Write with the wire's rules: whole registers, in range, writable, EEPROM only without torque."""
        if self.write_mapped(address, data):
            return StatusError.NONE
        writes: list[tuple[Register, int]] = []
        at = 0
        while at < len(data):
            register = self.by_address.get(address + at)
            if register is None or not register.writable:
                return StatusError.ACCESS
            if register.address != address + at or at + register.size > len(data):
                return StatusError.DATA_LENGTH
            value = register.decode(data[at : at + register.size])
            if error := self._refuses(register, value):
                return error
            writes.append((register, value))
            at += register.size
        for register, value in writes:
            self._accept(register, value)
        return StatusError.NONE

    def _refuses(self, register: Register, value: int) -> StatusError:
        if register.eeprom and self.torque:
            return StatusError.ACCESS
        if not register.low <= value <= register.high or (register is reg.BUS_WATCHDOG and value < 0):
            return StatusError.DATA_RANGE
        if self.tripped and (_is_goal(register) or (register is reg.BUS_WATCHDOG and value != 0)):
            return StatusError.DATA_RANGE
        if register is reg.OPERATING_MODE and value not in self._modes():
            return StatusError.DATA_RANGE
        if register is reg.TORQUE_ENABLE and value and self.memory[reg.HARDWARE_ERROR.address]:
            return StatusError.RESULT_FAIL
        if register.address == reg.GOAL_CURRENT.address and abs(value) > self.get(reg.CURRENT_LIMIT):
            return StatusError.DATA_LIMIT
        mode = self.memory[reg.OPERATING_MODE.address]
        if register is reg.GOAL_POSITION and mode not in _EXTENDED_MODES:
            limits = self.get(reg.MIN_POSITION), self.get(reg.MAX_POSITION)
            return StatusError.NONE if limits[0] <= value <= limits[1] else StatusError.DATA_LIMIT
        return StatusError.NONE

    def _modes(self) -> set[int]:
        """Operating modes of the model; two of them need current registers."""
        return set(reg.MODE_NAMES) - (set() if self.model.ma_per_unit else {0, 5})

    def _accept(self, register: Register, value: int) -> None:
        changed_mode = register is reg.OPERATING_MODE and value != self.get(register)
        self.put(register, value)
        if changed_mode:
            self._reset_control()
            if value == _ONE_TURN_MODE:
                self._forget_turns()
        elif register is reg.BUS_WATCHDOG:
            self.fed_at = self.now
            if value == 0 and self.tripped_goal is not None:
                # The stale goal stays in its register; the motor stays stopped until a new one.
                self.tripped_goal = None
                self.motion.goal = self.motion.position
        elif register is reg.GOAL_POSITION or (register is reg.TORQUE_ENABLE and value):
            if register is reg.TORQUE_ENABLE and self.get(reg.OPERATING_MODE) == _ONE_TURN_MODE:
                self._forget_turns()
            self.motion.goal = self.get(reg.GOAL_POSITION) - self._count_offset()
        elif register is reg.TORQUE_ENABLE:
            self.motion.release()

    def _count_offset(self) -> int:
        """Reported position minus real position [ticks]."""
        return self.get(reg.HOMING_OFFSET) - self.forgotten_ticks

    # -- instructions --------------------------------------------------------------------------------------

    def feed(self, now: float) -> None:
        """Feed the Bus Watchdog; an instruction that addresses this servo does (the strict reading)."""
        self.advance(now)
        self.fed_at = now

    def register_write(self, address: int, data: bytes) -> StatusError:
        """REG WRITE."""
        self.registered = Registered(address, data)
        self.put(reg.REGISTERED, 1)
        return StatusError.NONE

    def action(self) -> StatusError:
        """ACTION."""
        waiting, self.registered = self.registered, None
        self.put(reg.REGISTERED, 0)
        return self.write(waiting.address, waiting.data) if waiting else StatusError.INSTRUCTION

    def clear(self, parameters: bytes) -> StatusError:
        """CLEAR: forget the turns; only at rest."""
        if parameters != _CLEAR_MULTI_TURN:
            return StatusError.DATA_RANGE
        if self.motion.velocity:
            return StatusError.RESULT_FAIL
        self._forget_turns()
        self.put(reg.GOAL_POSITION, self._present())
        return StatusError.NONE

    def factory_reset(self, option: int) -> StatusError:
        """FACTORY RESET: 0xFF everything, 1 all but the id, 2 all but id and baud rate."""
        if option not in (0x01, 0x02, 0xFF):
            return StatusError.DATA_RANGE
        if self.torque:
            return StatusError.ACCESS
        kept = {reg.MODEL_NUMBER, reg.FIRMWARE, *(((), (reg.ID,), (reg.ID, reg.BAUD))[option % 0xFF])}
        for register in self.table:
            if register.eeprom and register not in kept:
                self.put(register, register.default)
        self.reboot()
        return StatusError.NONE

    def reboot(self) -> None:
        """REBOOT, or a brown-out: RAM and turn count are lost, torque is off, no answers during the start."""
        self.booted_at = self.now + BOOT_S
        self._power_up()
        if self.cause:
            self.fail(self.cause)

    def _power_up(self) -> None:
        for register in self.table:
            if not register.eeprom:
                self.put(register, register.default)
        self.motion.release()
        self.registered = self.tripped_goal = None
        self._reset_control()
        self._forget_turns()
        self.put(reg.GOAL_POSITION, 0)
        if self.get(reg.STARTUP) & 1:
            self.put(reg.GOAL_POSITION, self._present())
            self.put(reg.TORQUE_ENABLE, 1)

    def _reset_control(self) -> None:
        for gain in reg.GAINS:
            self.put(gain, self.by_name[gain.name].default)
        for register in (reg.PROFILE_VELOCITY, reg.PROFILE_ACCELERATION, reg.GOAL_VELOCITY):
            self.put(register, 0)
        if self.model.ma_per_unit:
            self.put(reg.GOAL_CURRENT, self.get(reg.CURRENT_LIMIT))

    def _forget_turns(self) -> None:
        self.forgotten_ticks = math.floor(self.motion.position / reg.TICKS_PER_REV) * reg.TICKS_PER_REV

    # -- time ----------------------------------------------------------------------------------------------

    def advance(self, now: float) -> None:
        """Move on to ``now`` [s]."""
        while self.now < now:
            step = min(STEP_S, now - self.now)
            self.now += step
            self._watch()
            if self.torque and self.memory[reg.OPERATING_MODE.address] in _POSITION_MODES:
                self._limits()
                self.motion.step(step)
                if self.motion.overloaded:
                    self.fail(0x20)
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
        if not self.torque or not 1 <= armed <= 127:
            return
        if self.now - self.fed_at > armed * reg.WATCHDOG_MS_PER_UNIT / 1e3:
            self.trip()

    def trip(self) -> None:
        """Bus Watchdog trip: stop, and ignore goals until 0 is written."""
        self.put(reg.BUS_WATCHDOG, reg.WATCHDOG_TRIPPED)
        self.stopped_at = self.now
        if self.torque:
            self.motion.velocity = 0.0
            self.tripped_goal = self.motion.position + self.get(reg.HOMING_OFFSET)
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
        acceleration = self.get(reg.PROFILE_ACCELERATION) * reg.DEG_S2_PER_UNIT / 360.0 * reg.TICKS_PER_REV
        unit = self.model.ma_per_unit
        current = self.get(reg.CURRENT_LIMIT) if unit else LOAD_FULL_MA
        if self.memory[reg.OPERATING_MODE.address] == 5:
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

    def read_position(self) -> int:
        """Present Position now [ticks]."""
        return self._present()

    def _present(self) -> int:
        if self.frozen is not None:
            return self.frozen
        return round(self.motion.position) + self._count_offset()

    def _report(self) -> None:
        """Bring the read-only registers up to date."""
        motion = self.motion
        memory = self.memory
        current_ma = motion.current
        velocity = int(motion.velocity * reg.RAD_PER_TICK / reg.RAD_S_PER_UNIT)
        if self.frozen is not None and self.torque:
            # The position loop of the servo sees the same error for ever.
            current_ma = motion.pushing(self.get(reg.GOAL_POSITION) - self.frozen)
            velocity = 0
        # A model without current registers reports its load, 0.1 %, at the same address.
        current = int(current_ma / (self.model.ma_per_unit or LOAD_FULL_MA / 1e3))
        memory[126:128] = (current & 0xFFFF).to_bytes(2, "little")
        memory[128:132] = (velocity & 0xFFFFFFFF).to_bytes(4, "little")
        memory[132:136] = (self._present() & 0xFFFFFFFF).to_bytes(4, "little")
        memory[144] = self.supply_decivolt
        memory[122] = 1 if velocity else 0
        memory[120:122] = (int(self.now * 1e3) % 32768).to_bytes(2, "little")


def _is_goal(register: Register) -> bool:
    return reg.GOAL_PWM.address <= register.address <= reg.GOAL_POSITION.address and register not in (
        reg.PROFILE_ACCELERATION,
        reg.PROFILE_VELOCITY,
    )
