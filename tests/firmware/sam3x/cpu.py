"""A Cortex-M3 with its vector table, NVIC and SysTick, on unicorn; peripherals are memory-mapped blocks.

Unicorn has no NVIC: instructions run in short quanta; between them exceptions are entered and left here
as the ARMv7-M manual (B1.5) describes. Time is counted in instructions, each a fixed number of cycles.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Protocol

import unicorn
from unicorn import arm_const

CLOCK_HZ = 84_000_000
#: Instructions between two looks at exceptions; it is `QUIET` times as many while none runs or waits.
QUANTUM = 64
QUIET = 4
EXCEPTION_RETURN = 0xFFFF_FFF8
SYSTICK = 15
NEVER = 1 << 62

_FRAME = (
    arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1, arm_const.UC_ARM_REG_R2, arm_const.UC_ARM_REG_R3,
    arm_const.UC_ARM_REG_R12, arm_const.UC_ARM_REG_LR,
)  # fmt: skip


class Block(Protocol):
    """The registers of one peripheral, by offset from its address."""

    def read(self, offset: int) -> int: ...
    def write(self, offset: int, value: int) -> None: ...


class Timed(Protocol):
    """Something that happens at a cycle of its own."""

    due: int

    def fire(self) -> None: ...


class SystemControl:
    """SysTick, NVIC and the priorities of the system exceptions, at E000E000."""

    def __init__(self, cpu: Cpu) -> None:
        self._cpu = cpu
        self.enabled = 0
        self.pending = 0
        self.lines = 0  # requests that peripherals hold up
        self.priority = bytearray(256)  # by exception number; the upper four bits count
        self.vectors = 0x0008_0000
        self.systick_control = 0
        self.systick_reload = 0
        self.systick_pending = False
        self.due = NEVER

    def fire(self) -> None:
        self.due += self.systick_reload + 1
        self.systick_control |= 1 << 16
        self.systick_pending = bool(self.systick_control & 2)

    def read(self, offset: int) -> int:
        if offset == 0x10:
            value, self.systick_control = self.systick_control, self.systick_control & 7
            return value
        if offset == 0x14:
            return self.systick_reload
        if offset == 0x18:
            return max(0, self.due - self._cpu.cycles) if self.due != NEVER else 0
        if offset in (0x100, 0x104, 0x180, 0x184):
            return self.enabled >> 32 * (offset % 8 // 4) & 0xFFFF_FFFF
        if offset in (0x200, 0x204):
            return (self.pending | self.lines) >> 32 * (offset % 8 // 4) & 0xFFFF_FFFF
        if 0x400 <= offset < 0x430:
            return int.from_bytes(self.priority[offset - 0x3F0 : offset - 0x3EC], "little")
        if offset == 0xD04:
            return int(self.systick_pending) << 26
        if offset == 0xD08:
            return self.vectors
        return 0

    def write(self, offset: int, value: int) -> None:
        shift = 32 * (offset % 8 // 4)
        if offset == 0x10:
            self.systick_control = value & 7
            self.due = self._cpu.cycles + self.systick_reload + 1 if value & 1 else NEVER
        elif offset == 0x14:
            self.systick_reload = value
        elif offset in (0x100, 0x104):
            self.enabled |= value << shift
        elif offset in (0x180, 0x184):
            self.enabled &= ~(value << shift)
        elif offset in (0x200, 0x204):
            self.pending |= value << shift
        elif offset in (0x280, 0x284):
            self.pending &= ~(value << shift)
        elif offset == 0xD04:
            self.systick_pending &= not value & 1 << 25
        elif offset == 0xD08:
            self.vectors = value

    def write_priority(self, number: int, data: bytes) -> None:
        for i, byte in enumerate(data):
            self.priority[number + i] = byte & 0xF0

    def waiting(self) -> tuple[int, int] | None:
        """The most urgent exception that waits: its priority and its number."""
        best = (self.priority[SYSTICK], SYSTICK) if self.systick_pending else None
        ready = (self.pending | self.lines) & self.enabled
        while ready:
            number = (ready & -ready).bit_length() - 1
            ready &= ready - 1
            one = (self.priority[16 + number], 16 + number)
            if best is None or one < best:
                best = one
        return best


class Cpu:
    """The processor and its time. ``cycles_per_instruction`` stretches or shortens it."""

    def __init__(self, cycles_per_instruction: float = 1.5) -> None:
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
        self.uc.mem_map(0x2007_0000, 96 * 1024)
        for base, size in ((0x4000_0000, 0x20_0000), (0xE000_E000, 0x1000)):
            self.uc.mmio_map(base, size, self._read, base, self._write, base)

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
            quantum = QUIET * self.quantum if quiet and not self._active else self.quantum
            left = min(until, due) - self.cycles
            self._step(max(1, min(quantum, int(left / self.cycles_per_instruction))))

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
        self.cycles += max(1, int(instructions * self.cycles_per_instruction))

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

    def _read(self, _: object, offset: int, size: int, base: int) -> int:
        address = base + offset
        if base == 0xE000_E000:
            return self.system.read(offset)
        found = self._blocks.get(address & ~15)
        value = 0 if found is None else found[1].read(address - found[0] & ~3)
        return value >> 8 * (address & 3) & (1 << 8 * size) - 1

    def _write(self, _: object, offset: int, size: int, value: int, base: int) -> None:
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
