"""Register models of the SAM3X8E: PIO, PWM, TC, ADC, PMC, WDT, RSTC, SUPC, GPBR.

Offsets and bits as in the datasheet (Atmel-11057). A register without behaviour keeps what was written.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from tests.firmware.sam3x.cpu import CLOCK_HZ, Cpu
from tests.firmware.sam3x.system_control import NEVER


class Plain:
    """Keeps what was written; `fixed` holds registers that read as a constant."""

    def __init__(self, **fixed: int) -> None:
        self.words: dict[int, int] = {}
        self.fixed = {int(name[1:], 16): value for name, value in fixed.items()}

    def read(self, offset: int) -> int:
        return self.fixed.get(offset, self.words.get(offset, 0))

    def keeps(self, offset: int) -> bool:
        return True

    def write(self, offset: int, value: int) -> None:
        self.words[offset] = value


class Pmc(Plain):
    """Clocks are ready at once; `clocks` holds the peripherals with a clock, one bit each."""

    def __init__(self) -> None:
        super().__init__(x68=0xFFFF_FFFF)
        self.clocks = 0

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if offset in (0x10, 0x100):
            self.clocks |= value << (32 if offset == 0x100 else 0)
        elif offset in (0x14, 0x104):
            self.clocks &= ~(value << (32 if offset == 0x104 else 0))


class Pio:
    """A port. ``levels`` is what the outside applies to its pins."""

    #: Status register: the offsets that set and clear its bits.
    PAIRS: ClassVar = {
        0x08: (0x00, 0x04), 0x18: (0x10, 0x14), 0x28: (0x20, 0x24), 0x38: (0x30, 0x34), 0x48: (0x40, 0x44),
        0x58: (0x50, 0x54), 0x68: (0x60, 0x64), 0x88: (0x84, 0x80), 0xA8: (0xA0, 0xA4), 0xB8: (0xB0, 0xB4),
    }  # fmt: skip

    def __init__(self, cpu: Cpu, irq: int) -> None:
        self._cpu, self._irq = cpu, irq
        self.status = dict.fromkeys(self.PAIRS, 0)
        self.status[0x08] = 0xFFFF_FFFF
        self.words: dict[int, int] = {}
        self.levels = 0xFFFF_FFFF
        self.changed = 0

    def pins(self) -> int:
        driven = self.status[0x18] & self.status[0x08]
        return self.status[0x38] & driven | self.levels & ~driven

    def set_levels(self, mask: int, value: int) -> None:
        fresh = self.levels & ~mask | value & mask
        self.changed |= fresh ^ self.levels
        self.levels = fresh
        self._cpu.line(self._irq, bool(self.changed & self.status[0x48]))

    def keeps(self, offset: int) -> bool:
        return offset != 0x4C

    def read(self, offset: int) -> int:
        if offset == 0x3C:
            return self.pins()
        if offset == 0x4C:
            changed, self.changed = self.changed, 0
            self._cpu.line(self._irq, False)
            return changed
        return self.status.get(offset, self.words.get(offset, 0))

    def write(self, offset: int, value: int) -> None:
        for status, (sets, clears) in self.PAIRS.items():
            if offset == sets:
                self.status[status] |= value
            elif offset == clears:
                self.status[status] &= ~value
        if offset == 0x38:
            self.status[0x38] = self.status[0x38] & ~self.status[0xA8] | value & self.status[0xA8]
        elif offset in (0x70, 0x8C):
            self.words[offset] = value
        self._cpu.line(self._irq, bool(self.changed & self.status[0x48]))


class Pwm(Plain):
    """Eight channels; ``history`` holds every write of a mode register."""

    def __init__(self) -> None:
        super().__init__()
        self.enabled = 0
        self.modes: list[tuple[int, int]] = []

    def channel(self, number: int, register: int) -> int:
        return self.words.get(0x200 + 0x20 * number + register, 0)

    def frequency_hz(self, number: int) -> float:
        """Left-aligned, from the channel's own clock selection (CPRE 0-10: MCK over 2^CPRE; 11: CLKA)."""
        select = self.channel(number, 0) & 15
        clock = self.words.get(0, 0)
        if select <= 10:
            source = CLOCK_HZ / (1 << select)
        else:
            divider = clock & 0xFF if select == 11 else clock >> 16 & 0xFF
            prescaler = clock >> 8 & 15 if select == 11 else clock >> 24 & 15
            source = CLOCK_HZ / (1 << prescaler) / divider if divider else 0.0
        return source / self.channel(number, 0x0C)

    def read(self, offset: int) -> int:
        return self.enabled if offset == 0x0C else super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset in (0x04, 0x08):
            self.enabled = self.enabled | value if offset == 0x04 else self.enabled & ~value
            return
        number, register = divmod(offset - 0x200, 0x20)
        if offset >= 0x200:
            if register == 0x00:
                self.modes.append((number, value))
            on = bool(self.enabled & 1 << number)
            if register in (0x08, 0x10):  # the update registers act on an enabled channel only
                if on:
                    self.words[offset - 4] = value
                return
            if register in (0x04, 0x0C) and on:
                return  # ignored while the channel runs
        self.words[offset] = value


class Tc(Plain):
    """A block of three channels. Channel 0 may be a quadrature decoder, whose count is set from outside."""

    def __init__(self, cpu: Cpu, first_irq: int) -> None:
        super().__init__()
        self._cpu, self._irq = cpu, first_irq
        self.count = 0
        self.quadrature_error = False
        self.status = self.mask = 0
        self.running = False
        self.ticks = 0
        self.due = NEVER

    def fire(self) -> None:
        """RC compare of channel 0."""
        self.due += 2 * self.words[0x1C]  # TIMER_CLOCK1 is MCK/2
        self.ticks += 1
        self.status |= 1 << 4
        self._cpu.line(self._irq, bool(self.status & self.mask))

    def keeps(self, offset: int) -> bool:
        return offset not in (0x10, 0x20, 0xD4)

    def read(self, offset: int) -> int:
        if offset == 0x10 and self.due != NEVER:  # counts MCK/2 up to RC
            compare = self.words[0x1C]
            return (compare - (self.due - self._cpu.cycles) // 2) % compare
        if offset == 0x10:
            return self.count & 0xFFFF_FFFF if self.words.get(0xC4, 0) & 1 << 8 and self.running else 0
        if offset == 0x20:
            status, self.status = self.status, 0
            self._cpu.line(self._irq, False)
            return status
        if offset == 0xD4:
            error, self.quadrature_error = self.quadrature_error, False
            return error << 2
        return self.mask if offset == 0x2C else super().read(offset)

    def write(self, offset: int, value: int) -> None:
        if offset == 0x24:
            self.mask |= value
        elif offset == 0x28:
            self.mask &= ~value
        elif offset == 0x00:
            self.running = bool(value & 1) or (self.running and not value & 2)
            compares = self.running and self.words.get(0x1C, 0) and self.words.get(0x04, 0) & 0x8007 == 0x8000
            self.due = self._cpu.cycles + 2 * self.words[0x1C] if compares else NEVER
        self.words[offset] = value


class Adc(Plain):
    """Software triggered; a conversion is ready at once. ``analog`` is the 12-bit input of each channel."""

    def __init__(self) -> None:
        super().__init__()
        self.enabled = 0
        self.analog = [0] * 16

    def read(self, offset: int) -> int:
        return self.enabled if offset == 0x18 else super().read(offset)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if offset == 0x10:
            self.enabled |= value
        elif offset == 0x14:
            self.enabled &= ~value
        elif offset == 0x00 and value & 2:
            for channel in range(16):
                if self.enabled & 1 << channel:
                    self.words[0x50 + 4 * channel] = self.analog[channel]


class Supply(Plain):
    """The supply controller; its monitor compares VDDUTMI with its threshold while it is on."""

    def __init__(self) -> None:
        super().__init__()
        self.millivolt = 3300

    def read(self, offset: int) -> int:
        mode = self.words.get(0x04, 0)
        threshold_mv = 1900 + 100 * (mode & 15)
        low = mode >> 8 & 7 != 0 and self.millivolt < threshold_mv
        return low << 5 | low << 6 if offset == 0x14 else super().read(offset)


class Watchdog(Plain):
    """Counts down at 32768/128 Hz from WDV; the mode can be written once after a reset."""

    def __init__(self, cpu: Cpu, on_expiry: Callable[[], None]) -> None:
        super().__init__(x4=0x3FFF_2FFF)
        self._cpu, self._on_expiry = cpu, on_expiry
        self.mode = 0x3FFF_2FFF
        self.written = False
        self.due = NEVER

    @property
    def period_s(self) -> float:
        return (self.mode & 0xFFF) * 128 / 32768

    def restart(self) -> None:
        self.due = NEVER if self.mode & 1 << 15 else self._cpu.cycles + int(self.period_s * CLOCK_HZ)

    def fire(self) -> None:
        self.due = NEVER
        if self.mode & 1 << 13:
            self._on_expiry()

    def read(self, offset: int) -> int:
        return self.mode if offset == 4 else 0

    def write(self, offset: int, value: int) -> None:
        if offset == 0 and value == 0xA500_0001:
            self.restart()
        elif offset == 4 and not self.written:
            self.mode, self.written = value, True
            self.restart()


class Flash(Plain):
    """The flash controller of plane 0. While the unique id is readable the whole plane reads as the id."""

    PLANE, SIZE = 0x0008_0000, 256 * 1024

    def __init__(self, cpu: Cpu, unique_id: bytes) -> None:
        super().__init__()
        self._cpu, self._unique_id = cpu, unique_id
        self._contents: bytes | None = None

    def read(self, offset: int) -> int:
        return int(self._contents is None) if offset == 8 else super().read(offset)

    def write(self, offset: int, value: int) -> None:
        super().write(offset, value)
        if offset != 4 or value >> 24 != 0x5A:
            return
        if value & 0xFF == 0x0E and self._contents is None:
            self._contents = bytes(self._cpu.uc.mem_read(self.PLANE, self.SIZE))
            self._cpu.uc.mem_write(self.PLANE, self._unique_id * (self.SIZE // 16))
        elif value & 0xFF == 0x0F and self._contents is not None:
            self._cpu.uc.mem_write(self.PLANE, self._contents)
            self._contents = None


class Trng(Plain):
    """A new number at every start, once the key enables it."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number

    def read(self, offset: int) -> int:
        on = self.words.get(0) == 0x524E_4701
        return {0x1C: int(on), 0x50: self._number if on else 0}.get(offset, 0)
