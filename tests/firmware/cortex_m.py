"""A Cortex-M that runs the firmware's core instruction by instruction (unicorn), and counts them."""

from __future__ import annotations

import struct

import unicorn
from unicorn import arm_const

from contid_devices.due.cortex import FLASH_BYTES, RAM_BYTES, RAM_START
from tests.firmware.elf import Image

FLASH_START = 0x0008_0000
PAGE = 0x1000
RETURN_TO = FLASH_START + FLASH_BYTES - 0x100
STACK_TOP = RAM_START + RAM_BYTES


class CortexM:
    def __init__(self, image: Image, model: int) -> None:
        self.image = image
        self.instructions = 0
        self._machine = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._machine.ctl_set_cpu_model(model)
        self._machine.mem_map(FLASH_START, FLASH_BYTES)
        self._machine.mem_map(RAM_START, RAM_BYTES)
        for address, data in image.segments:
            self._machine.mem_write(address, data)
        self._hook = None

    def call(self, name: str, *arguments: int, count: bool = False) -> int:
        """Call a function; with `count`, `instructions` is how many it executed."""
        for register, value in zip(
            (arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1, arm_const.UC_ARM_REG_R2),
            arguments,
            strict=False,
        ):
            self._machine.reg_write(register, value & 0xFFFFFFFF)
        self._machine.reg_write(arm_const.UC_ARM_REG_SP, STACK_TOP)
        self._machine.reg_write(arm_const.UC_ARM_REG_LR, RETURN_TO | 1)
        hook = None
        if count:
            self.instructions = 0
            hook = self._machine.hook_add(unicorn.UC_HOOK_CODE, self._one_more)
        self._machine.emu_start(self.image.symbols[name] | 1, RETURN_TO)
        if hook is not None:
            self._machine.hook_del(hook)
        return int(self._machine.reg_read(arm_const.UC_ARM_REG_R0))

    def _one_more(self, *_: object) -> None:
        self.instructions += 1

    def read(self, address: int, size: int) -> bytes:
        return bytes(self._machine.mem_read(address, size))

    def write_word(self, address: int, value: int) -> None:
        self._machine.mem_write(address, struct.pack("<i", value))


class CoreBoard:
    """The core on that processor, with the calls the vectors need."""

    def __init__(self, image: Image, model: int = arm_const.UC_CPU_ARM_CORTEX_M3) -> None:
        self.cpu = CortexM(image, model)

    def start(self, role: str) -> None:
        self.cpu.call("m3_start", 0 if role == "motor" else 1)
        for word in range(20):
            self.cpu.write_word(self.cpu.image.symbols["m3_inputs"] + 4 * word, 0)

    def tick(self, count: bool = False) -> int:
        self.cpu.call("m3_tick", count=count)
        return self.cpu.instructions

    def set_count(self, channel: int, value: int) -> None:
        self.cpu.write_word(self.cpu.image.symbols["m3_inputs"] + 4 * channel, value)

    def set_analog(self, channel: int, value: int) -> None:
        self.cpu.write_word(self.cpu.image.symbols["m3_inputs"] + 24 + 4 * channel, value)

    def wire(self, data: bytes) -> bytes:
        answer = b""
        for byte in data:
            size = self.cpu.call("m3_take", byte)
            if size:
                answer += self.cpu.read(self.cpu.call("m3_reply"), size)
        return answer
