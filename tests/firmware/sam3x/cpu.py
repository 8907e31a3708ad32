"""A Cortex-M3 with its vector table, NVIC and SysTick, on unicorn; peripherals are memory-mapped blocks.

Unicorn has no NVIC: instructions run in short quanta; between them exceptions are entered and left here
as the ARMv7-M manual (B1.5) describes. Time is counted in instructions, each a fixed number of cycles.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Iterator, Sequence
from typing import Protocol

import unicorn
from unicorn import arm_const

from tests.firmware.sam3x.system_control import SYSTICK, SystemControl
from tests.firmware.sam3x.turns import Turns

CLOCK_HZ = 84_000_000
#: Instructions between two looks at exceptions; it is `QUIET` times as many while none runs or waits.
QUANTUM = 64
QUIET = 4
EXCEPTION_RETURN = 0xFFFF_FFF8
MEMORY = 96 * 1024

_FRAME = (
    arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1, arm_const.UC_ARM_REG_R2, arm_const.UC_ARM_REG_R3,
    arm_const.UC_ARM_REG_R12, arm_const.UC_ARM_REG_LR,
)  # fmt: skip


class Block(Protocol):
    """The registers of one peripheral, by offset from its address."""

    def read(self, offset: int) -> int: ...
    def write(self, offset: int, value: int) -> None: ...
    def keeps(self, offset: int) -> bool:
        """Whether a read changes nothing and gives the same until an event or a write."""
        ...


class Timed(Protocol):
    """Something that happens at a cycle of its own."""

    due: int

    def fire(self) -> None: ...


class Cpu:
    """The processor and its time. ``cycles_per_instruction`` stretches or shortens it."""

    def __init__(self, cycles_per_instruction: float = 1.5, skips: bool = True) -> None:
        self.cycles_per_instruction = cycles_per_instruction
        self.cycles = 0
        self.quantum = QUANTUM
        self._pc = 0
        self.exceptions: dict[int, int] = {}
        self.system = SystemControl(self)
        self.timed: list[Timed] = [self.system]
        self._blocks: dict[int, tuple[int, Block]] = {}
        self._active: list[tuple[int, int]] = []
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M3)
        self.uc.mem_map(0x0008_0000, 512 * 1024)
        self._memory = ctypes.create_string_buffer(MEMORY)
        self.uc.mem_map_ptr(0x2007_0000, MEMORY, unicorn.UC_PROT_ALL, ctypes.addressof(self._memory))
        for base, size in ((0x4000_0000, 0x20_0000), (0xE000_E000, 0x1000)):
            self.uc.mmio_map(base, size, self._read, base, self._write, base)
        self.turns = Turns(self, self._memory) if skips else None

    def add(self, base: int, size: int, block: Block) -> None:
        for page in range(base, base + size, 16):
            self._blocks[page] = (base, block)

    def line(self, irq: int, level: bool) -> None:
        """A peripheral holds its request up, or takes it back."""
        if level:
            self.system.lines |= 1 << irq
        else:
            self.system.lines &= ~(1 << irq)

    def boot(self) -> None:
        stack, entry = struct.unpack("<II", self.uc.mem_read(self.system.vectors, 8))
        self._active.clear()
        self.uc.reg_write(arm_const.UC_ARM_REG_PRIMASK, 0)
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, stack)
        self.uc.reg_write(arm_const.UC_ARM_REG_PC, entry | 1)

    def run(self, until: int) -> None:
        """Execute up to a cycle."""
        self._pc = self.uc.reg_read(arm_const.UC_ARM_REG_PC)
        while self.cycles < until:
            while (due := min([one.due for one in self.timed])) <= self.cycles:
                min(self.timed, key=lambda one: one.due).fire()
            quiet = self.system.waiting() is None or self._enter_waiting()
            quiet = quiet and not self._active
            if quiet and self.turns is not None and self._skip(self.turns, min(until, due)):
                continue
            quantum = QUIET * self.quantum if quiet else self.quantum
            self._step(self._instructions(min(until, due) - self.cycles, quantum))

    def _instructions(self, left: int, quantum: int) -> int:
        return max(1, min(quantum, int(left / self.cycles_per_instruction)))

    def _took(self, instructions: int) -> int:
        return max(1, int(instructions * self.cycles_per_instruction))

    def _skip(self, turns: Turns, until: int) -> bool:
        """Let the time pass up to an event, where the program only waits for one."""
        if until - self.cycles < 2 * self._took(QUIET * self.quantum):
            return False
        end = self.cycles

        def steps() -> Iterator[int]:
            nonlocal end
            quantum = QUIET * self.quantum
            took, ratio = self._took(quantum), self.cycles_per_instruction
            while int((until - end) / ratio) >= quantum:
                end += took
                yield quantum
            while end < until:
                instructions = self._instructions(until - end, quantum)
                end += self._took(instructions)
                yield instructions

        pc = turns.skip(self._pc, steps)
        if pc is None:
            return False
        self._pc = pc
        turns.skipped += end - self.cycles
        self.cycles = end
        return True

    def _step(self, instructions: int) -> None:
        try:
            self.uc.emu_start(self._pc | 1, EXCEPTION_RETURN, count=instructions)
        except unicorn.UcError as error:  # nothing can be fetched there
            at = self.uc.reg_read(arm_const.UC_ARM_REG_PC)
            if at & ~1 != EXCEPTION_RETURN:
                raise RuntimeError(f"the processor faults at {at:#x}: {error}") from error
        self._pc = self.uc.reg_read(arm_const.UC_ARM_REG_PC)
        if self._pc & ~1 == EXCEPTION_RETURN:
            self._leave()
            instructions = (instructions + 1) // 2  # how many ran is not known: half, on average
            self.cycles += 12
        self.cycles += self._took(instructions)

    def _enter_waiting(self) -> bool:
        """Enter the most urgent exception; false while it has to wait."""
        waiting = self.system.waiting()
        if waiting is None or self.uc.reg_read(arm_const.UC_ARM_REG_PRIMASK) & 1:
            return False
        if self._active and waiting[0] >= min(self._active)[0]:
            return False
        priority, number = waiting
        if number == SYSTICK:
            self.system.systick_pending = False
        else:
            self.system.pending &= ~(1 << (number - 16))
        self.exceptions[number] = self.exceptions.get(number, 0) + 1
        self._active.append((priority, number))
        state = [self.uc.reg_read(register) for register in _FRAME]
        state += [self._pc, self.uc.reg_read(arm_const.UC_ARM_REG_XPSR)]
        stack = self.uc.reg_read(arm_const.UC_ARM_REG_SP)
        aligned = (stack - 32) & ~7
        state[7] = state[7] & ~0x200 | (0x200 if aligned != stack - 32 else 0)
        self.uc.mem_write(aligned, struct.pack("<8I", *state))
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, aligned)
        self.uc.reg_write(arm_const.UC_ARM_REG_LR, EXCEPTION_RETURN | 1)
        handler = struct.unpack("<I", self.uc.mem_read(self.system.vectors + 4 * number, 4))[0]
        self._pc = handler & ~1
        self.cycles += 12
        return True

    def _leave(self) -> None:
        self._active.pop()
        stack = self.uc.reg_read(arm_const.UC_ARM_REG_SP)
        state: Sequence[int] = struct.unpack("<8I", self.uc.mem_read(stack, 32))
        for register, value in zip(_FRAME, state, strict=False):
            self.uc.reg_write(register, value)
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, stack + 32 + (4 if state[7] & 0x200 else 0))
        self.uc.reg_write(arm_const.UC_ARM_REG_XPSR, state[7] & 0xF800_0000 | 1 << 24)
        self._pc = state[6] & ~1
        self.uc.reg_write(arm_const.UC_ARM_REG_PC, state[6] | 1)

    def refuses(self) -> bool:
        """Whether an access that changes something is left out, because a turn is only rehearsed."""
        return self.turns is not None and self.turns.refuses()

    def _read(self, _: object, offset: int, size: int, base: int) -> int:
        address = base + offset
        found = self._blocks.get(address & ~15)
        rehearsal = None if self.turns is None else self.turns.rehearsal
        if rehearsal is not None:
            rehearsal.reads.append(address)
            if base == 0xE000_E000 or not (found is None or found[1].keeps(address - found[0] & ~3)):
                self.refuses()
                return 0
        if base == 0xE000_E000:
            return self.system.read(offset)
        value = 0 if found is None else found[1].read(address - found[0] & ~3)
        return value >> 8 * (address & 3) & (1 << 8 * size) - 1

    def _write(self, _: object, offset: int, size: int, value: int, base: int) -> None:
        if self.refuses():
            return
        address = base + offset
        if base == 0xE000_E000:
            if 0x400 <= offset < 0x430:
                self.system.write_priority(offset - 0x3F0, value.to_bytes(size, "little"))
            elif 0xD18 <= offset < 0xD24:
                self.system.write_priority(offset - 0xD14, value.to_bytes(size, "little"))
            else:
                self.system.write(offset, value)
            return
        found = self._blocks.get(address & ~15)
        if found is not None:
            found[1].write(address - found[0], value)
