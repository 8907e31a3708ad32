"""The control table of an emulated servo, with indirect addressing."""

from __future__ import annotations

from typing import Final

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.models import BY_NUMBER
from contid_drivers.dynamixel.packets import ALERT
from contid_drivers.dynamixel.registers import Register

MEMORY_SIZE: Final = 256


class ControlTable:
    """Registers of a servo, initially at their factory values."""

    def __init__(self, model: int, firmware: int) -> None:
        self.model = BY_NUMBER.get(model, BY_NUMBER[reg.MODEL_NUMBER.default])
        self.indirect_data = self.model.indirect_data(firmware)
        self.table = reg.table_of(self.indirect_data, self.model.current_limit, self.model.gains)
        self.by_address = {
            register.address + i: register for register in self.table for i in range(register.size)
        }
        self.by_name = {register.name: register for register in self.table}
        self._indirect_count = sum(register.name.startswith("indirect data") for register in self.table)
        self.memory = bytearray(MEMORY_SIZE)
        for register in self.table:
            self.put(register, register.default)

    def get(self, register: Register) -> int:
        """Value of a register."""
        return register.decode(self.memory[register.address : register.address + register.size])

    def put(self, register: Register, value: int) -> None:
        """Set a register without the rules of the wire."""
        self.memory[register.address : register.address + register.size] = register.encode(value)

    @property
    def device(self) -> int:
        """Id on the bus."""
        return self.memory[reg.ID.address]

    @property
    def baud(self) -> int:
        """Baud rate."""
        return reg.BAUD_CODES[self.memory[reg.BAUD.address]]

    @property
    def torque(self) -> bool:
        """True while the motor is driven."""
        return self.memory[reg.TORQUE_ENABLE.address] == 1

    @property
    def tripped(self) -> bool:
        """True from a Bus Watchdog trip until 0 is written to it."""
        return self.memory[reg.BUS_WATCHDOG.address] == reg.WATCHDOG_TRIPPED

    @property
    def return_delay_s(self) -> float:
        """Between the end of an instruction and the start of its answer."""
        return self.memory[reg.RETURN_DELAY.address] * 2e-6

    @property
    def alert(self) -> int:
        """Alert bit of the status error."""
        return ALERT if self.memory[reg.HARDWARE_ERROR.address] else 0

    def read(self, address: int, size: int) -> bytes:
        """Bytes of the table, indirect data resolved; zeros beyond its end."""
        memory = self.memory
        if address + size > MEMORY_SIZE:
            return bytes(size)
        if address < self.indirect_data:
            return bytes(memory[address : address + size])
        return bytes(memory[self._resolve(address + i)] for i in range(size))

    def write_mapped(self, address: int, data: bytes) -> bool:
        """Write through the indirect addresses; False where these bytes are not mapped elsewhere."""
        start = self.indirect_data
        if not start <= address <= address + len(data) <= start + self._indirect_count:
            return False
        places = [self._resolve(address + i) for i in range(len(data))]
        if places == list(range(address, address + len(data))):
            return False
        for place, byte in zip(places, data, strict=True):
            self.memory[place] = byte
        return True

    def _resolve(self, address: int) -> int:
        entry = address - self.indirect_data
        if not 0 <= entry < self._indirect_count:
            return address
        at = reg.INDIRECT_ADDRESS + 2 * entry
        return min(self.memory[at] | self.memory[at + 1] << 8, MEMORY_SIZE - 1)
