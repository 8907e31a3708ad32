"""SysTick, NVIC and the priorities of the exceptions of the Cortex-M3."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.firmware.sam3x.cpu import Cpu

SYSTICK = 15
#: The cycle of an event that does not come.
NEVER = 1 << 62


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
