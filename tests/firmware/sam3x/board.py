"""The whole chip around the processor, flashed with an ELF file."""

from __future__ import annotations

import struct
from pathlib import Path

from tests.firmware.sam3x.cpu import CLOCK_HZ, Cpu
from tests.firmware.sam3x.registers import Adc, Flash, Pio, Plain, Pmc, Pwm, Supply, Tc, Trng, Watchdog
from tests.firmware.sam3x.system_control import NEVER
from tests.firmware.sam3x.uart import Uart
from tests.firmware.sam3x.usb import Usb

POWER_UP, WATCHDOG = 0, 2
UNIQUE_ID = bytes(range(0x30, 0x40))


class Sam3x:
    """``run_ms`` runs it. A watchdog reset boots it with new register models; ``resets`` counts them."""

    def __init__(
        self, elf: Path, cycles_per_instruction: float = 1.5, full_speed: bool = False, skips: bool = True
    ) -> None:
        """``skips``: the turns of a loop that waits are not emulated one by one (`turns`)."""
        self._skips = skips
        self._segments = flash_segments(elf)
        self._cycles_per_instruction = cycles_per_instruction
        self._full_speed = full_speed
        self.resets = 0
        self.elapsed_ms = 0.0
        self.backup = Plain()
        self._expired = False
        self._jumper = False
        self._power(POWER_UP)

    def _power(self, cause: int) -> None:
        self.cpu = cpu = Cpu(self._cycles_per_instruction, self._skips)
        for address, data in self._segments:
            cpu.uc.mem_write(address, data)
        self.pmc, self.pwm, self.adc, self.supply = Pmc(), Pwm(), Adc(), Supply()
        self.pio = {letter: Pio(cpu, 11 + i) for i, letter in enumerate("ABCD")}
        self.tc = [Tc(cpu, 27 + 3 * i) for i in range(3)]
        self.watchdog = Watchdog(cpu, self._expire)
        self.uart, self.usb = Uart(cpu), Usb(cpu, self._full_speed)
        cpu.timed += [*self.tc, self.watchdog, self.uart, self.usb]
        self.watchdog.restart()
        for i, block in enumerate(self.tc):
            cpu.add(0x4008_0000 + 0x4000 * i, 0x100, block)
        cpu.add(0x4009_4000, 0x400, self.pwm)
        cpu.add(0x400A_C000, 0x900, self.usb)
        cpu.add(0x400C_0000, 0x130, self.adc)
        cpu.add(0x400C_8000, 0x130, Plain())
        cpu.add(0x400E_0600, 0x120, self.pmc)
        cpu.add(0x400E_0800, 0x130, self.uart)
        cpu.add(0x400B_C000, 0x60, Trng(0x5EED_0000 + self.resets))
        cpu.add(0x400E_0A00, 0x20, Flash(cpu, UNIQUE_ID))
        cpu.add(0x400E_0C00, 0x20, Plain(x8=1))
        for i, port in enumerate(self.pio.values()):
            cpu.add(0x400E_0E00 + 0x200 * i, 0x100, port)
        cpu.add(0x400E_1A00, 0x10, Plain(x4=cause << 8))
        cpu.add(0x400E_1A10, 0x20, self.supply)
        cpu.add(0x400E_1A50, 0x10, self.watchdog)
        cpu.add(0x400E_1A90, 0x20, self.backup)
        if self._jumper:
            self.jumper()
        cpu.boot()

    def _expire(self) -> None:
        self._expired = True
        self.watchdog.due = NEVER

    def jumper(self) -> None:
        """The role jumper is fitted: a pressure board from the next start on."""
        self._jumper = True
        self.pio["B"].set_levels(1 << 14, 0)

    def run_ms(self, milliseconds: float) -> None:
        left = milliseconds * CLOCK_HZ / 1000
        while left > 0:
            chunk = min(left, CLOCK_HZ / 4000)
            start = self.cpu.cycles
            self.cpu.run(start + max(1, int(chunk)))
            left -= self.cpu.cycles - start
            if self._expired:
                self._expired = False
                self.resets += 1
                self._power(WATCHDOG)
        self.elapsed_ms += milliseconds

    def ask_uart(self, frame: bytes, timeout_ms: float = 50) -> bytes:
        """One request over the programming port; the answer up to its zero, or what came in time."""
        start = len(self.uart.sent)
        self.uart.feed(frame)
        for _ in range(int(timeout_ms * 20)):
            self.run_ms(0.05)
            if 0 in self.uart.sent[start:]:
                break
        return bytes(self.uart.sent[start:])

    def ask_usb(self, frame: bytes, timeout_ms: float = 50) -> bytes:
        """The same over the native port."""
        start = len(self.usb.received)
        self.usb.send(frame)
        for _ in range(int(timeout_ms * 20)):
            self.run_ms(0.05)
            if 0 in self.usb.received[start:]:
                break
        return bytes(self.usb.received[start:])


def flash_segments(elf: Path) -> list[tuple[int, bytes]]:
    """What a programmer writes: the contents of each segment, at its load address."""
    data = elf.read_bytes()
    table, size, count = *struct.unpack_from("<I", data, 28), *struct.unpack_from("<HH", data, 42)
    segments = []
    for i in range(count):
        kind, offset, _, load, in_file, _ = struct.unpack_from("<6I", data, table + i * size)
        if kind == 1 and in_file:
            segments.append((load, data[offset : offset + in_file]))
    return segments
