"""One emulated XL330: its machine and the rules of its instructions.

It reproduces the hazards of the real servo: goals are kept while torque is off, so torque on jumps unless the
goal was set first; the turn count is lost at a reboot, in position mode and by CLEAR; a tripped Bus Watchdog
ignores goals until 0 is written, and with a Homing Offset it moves the motor when it trips (DynamixelSDK
issue 584).
"""

from __future__ import annotations

from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.packets import StatusError
from contid_drivers.dynamixel.registers import Register
from contid_emulate.dynamixel.machine import ServoMachine

_EXTENDED_MODES: Final = (4, 5)
#: Position mode: entering it, and torque on in it, reduce Present Position to one turn (register 132).
_ONE_TURN_MODE: Final = 3
#: Goals, which a tripped Bus Watchdog ignores.
_GOALS: Final = tuple(
    goal.address for goal in (reg.GOAL_PWM, reg.GOAL_CURRENT, reg.GOAL_VELOCITY, reg.GOAL_POSITION)
)
_CLEAR_MULTI_TURN: Final = b"\x01\x44\x58\x4c\x22"


class Servo(ServoMachine):
    """An emulated servo."""

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
        if self.tripped and (register.address in _GOALS or (register is reg.BUS_WATCHDOG and value != 0)):
            return StatusError.DATA_RANGE
        if register is reg.OPERATING_MODE and value not in self._modes():
            return StatusError.DATA_RANGE
        if register is reg.TORQUE_ENABLE and value and self.memory[reg.HARDWARE_ERROR.address]:
            return StatusError.RESULT_FAIL
        if register.address == reg.GOAL_CURRENT.address and abs(value) > self.get(reg.CURRENT_LIMIT):
            return StatusError.DATA_LIMIT
        if register is reg.GOAL_PWM and abs(value) > self.get(reg.PWM_LIMIT):
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
            self.reset_control()
            if value == _ONE_TURN_MODE:
                self.forget_turns()
        elif register is reg.BUS_WATCHDOG:
            self.fed_at = self.now
            if value == 0 and self.tripped_goal is not None:
                # The stale goal stays in its register; the motor stays stopped until a new one.
                self.tripped_goal = None
                self.motion.goal = self.motion.seen
        elif register is reg.GOAL_POSITION or (register is reg.TORQUE_ENABLE and value):
            if register is reg.TORQUE_ENABLE and self.get(reg.OPERATING_MODE) == _ONE_TURN_MODE:
                self.forget_turns()
            self.motion.goal = self.get(reg.GOAL_POSITION) - self.count_offset()
        elif register is reg.TORQUE_ENABLE:
            self.motion.release()

    # -- instructions --------------------------------------------------------------------------------------

    def feed(self, now: float) -> None:
        """Feed the Bus Watchdog; an instruction that addresses this servo does (the strict reading)."""
        self.advance(now)
        self.fed_at = now

    def register_write(self, address: int, data: bytes) -> StatusError:
        """REG WRITE."""
        self.registered = address, data
        self.put(reg.REGISTERED, 1)
        return StatusError.NONE

    def action(self) -> StatusError:
        """ACTION."""
        waiting, self.registered = self.registered, None
        self.put(reg.REGISTERED, 0)
        return self.write(*waiting) if waiting else StatusError.INSTRUCTION

    def clear(self, parameters: bytes) -> StatusError:
        """CLEAR: forget the turns; only at rest."""
        if parameters != _CLEAR_MULTI_TURN:
            return StatusError.DATA_RANGE
        if self.motion.velocity:
            return StatusError.RESULT_FAIL
        self.forget_turns()
        self.put(reg.GOAL_POSITION, self.present())
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
