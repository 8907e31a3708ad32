"""An emulated i.MX RT1062 as far as the sketch uses it: registers as memory, and those that act.

Start-up is the core's own (`analog_init`, `pwm_init`, constructors), without clocks and USB. The core's USB
serial functions are replaced at their entry: bytes go in and out there.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import unicorn
from unicorn import arm_const

from tests.firmware.elf import read_elf

CPU_HZ, BUS_HZ = 600_000_000, 150_000_000
RETURN_TO = 0x7F00_0000
STACK_TOP = 0x2007_F000
PIT_TFLG, PIT_TCTRL, PIT_LDVAL = 0x4008_410C, 0x4008_4108, 0x4008_4100
ADC1 = 0x400C_4000
ADC_HC0, ADC_HS, ADC_R0, ADC_GC = ADC1, ADC1 + 0x20, ADC1 + 0x24, ADC1 + 0x48
ADC2_GC = 0x400C_8048
WDOG3_CS, WDOG3_CNT, WDOG3_TOVAL = 0x400B_C000, 0x400B_C004, 0x400B_C008
TRNG_MCTL = 0x400C_C000
SRC_SRSR = 0x400F_8008
SNVS_LPGPR3 = 0x400D_410C
CYCLES = 0xE000_1004
NVIC_ENABLE, NVIC_DISABLE, NVIC_PRIORITY = 0xE000_E100, 0xE000_E180, 0xE000_E400
IRQ_ADC1, IRQ_PIT = 67, 122
ENCODERS = (0x403C_8000, 0x403C_C000, 0x403D_0000, 0x403D_4000)
GPIO = (0x4200_0000, 0x4200_4000, 0x4200_8000, 0x4200_C000)
POWER_UP, WATCHDOG = 1, 1 << 7
MAPPED = (
    (0x0000_0000, 0x8_0000), (0x2000_0000, 0x8_0000), (0x2020_0000, 0x8_0000), (0x6000_0000, 0x80_0000),
    (0x4000_0000, 0x400_0000), (0xE000_0000, 0x10_0000), (RETURN_TO, 0x1000),
)  # fmt: skip


class Teensy41:
    """``run_ms`` runs ticks, conversions and `loop`; ``analog`` are readings by channel of ADC1.

    Attributes:
        refreshed: how often the watchdog was fed.
        enabled: interrupts.
        both_changed: decoders whose tracks changed at once; the sketch clears it.
    """

    def __init__(self, elf: Path, pressure: bool = False, cause: int = POWER_UP, starts: int = 0) -> None:
        image = read_elf(elf)
        self.symbols = image.symbols
        self.analog: dict[int, int] = {}
        self.refreshed = 0
        self.enabled: set[int] = set()
        self.both_changed: set[int] = set()
        self._received = bytearray()
        self._sent = bytearray()
        self._converting = -1
        self._now_cycles = 0
        self.uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.uc.ctl_set_cpu_model(arm_const.UC_CPU_ARM_CORTEX_M7)
        for start, size in MAPPED:
            self.uc.mem_map(start, size)
        for address, data in image.segments:
            self.uc.mem_write(address, data)
        self.uc.reg_write(arm_const.UC_ARM_REG_C1_C0_2, 0xF << 20)
        self.uc.reg_write(arm_const.UC_ARM_REG_FPEXC, 1 << 30)
        self._install()
        self.set_word(self.symbols["F_CPU_ACTUAL"], CPU_HZ)
        self.set_word(self.symbols["F_BUS_ACTUAL"], BUS_HZ)
        self.set_word(SRC_SRSR, cause)
        self.set_word(SNVS_LPGPR3, starts)
        for port in GPIO:
            self.set_word(port + 8, 0xFFFF_FFFF)  # every input is pulled up
        if pressure:
            self.set_level(41, False)
        for name in ("analog_init", "pwm_init", "__libc_init_array", "setup"):
            self.call(name)

    # ---- memory ----

    def word(self, address: int) -> int:
        return int(struct.unpack("<I", self.uc.mem_read(address, 4))[0])

    def half(self, address: int) -> int:
        return int(struct.unpack("<H", self.uc.mem_read(address, 2))[0])

    def set_word(self, address: int, value: int) -> None:
        self.uc.mem_write(address, struct.pack("<I", value & 0xFFFF_FFFF))

    def set_half(self, address: int, value: int) -> None:
        self.uc.mem_write(address, struct.pack("<H", value & 0xFFFF))

    def pin(self, number: int) -> tuple[int, int, int, int]:
        """Port, multiplexer and pad register, and mask of a pin: the core's own table."""
        at = self.symbols["digital_pin_to_info_PGM"] + 16 * number
        port, mux, pad, mask = struct.unpack("<4I", self.uc.mem_read(at, 16))
        return port, mux, pad, mask

    def set_level(self, pin: int, high: bool) -> None:
        """What an input pin reads."""
        port, _, _, mask = self.pin(pin)
        level = self.word(port + 8)
        self.set_word(port + 8, level | mask if high else level & ~mask)

    def output(self, pin: int) -> bool | None:
        """The level that a pin drives as GPIO; None where it does not drive."""
        port, mux, _, mask = self.pin(pin)
        if self.word(mux) & 7 != 5 or not self.word(port + 4) & mask:
            return None
        return bool(self.word(port) & mask)

    # ---- running ----

    def call(self, name: str) -> None:
        """Call a function without arguments."""
        self._enter(self.symbols[name])

    def _enter(self, address: int) -> None:
        self.uc.reg_write(arm_const.UC_ARM_REG_SP, STACK_TOP)
        self.uc.reg_write(arm_const.UC_ARM_REG_LR, RETURN_TO | 1)
        self.uc.emu_start(address | 1, RETURN_TO, timeout=10_000_000)
        at = self.uc.reg_read(arm_const.UC_ARM_REG_PC)
        assert at == RETURN_TO, f"it hangs at {at:#x}"

    def _interrupt(self, number: int) -> None:
        self._enter(self.word(self.symbols["_VectorsRam"] + 4 * (16 + number)))

    def run_ms(self, milliseconds: int, ticks: bool = True, loop: bool = True) -> None:
        for _ in range(milliseconds):
            self._now_cycles += CPU_HZ // 1000
            if ticks and IRQ_PIT in self.enabled and self.word(PIT_TCTRL) & 3 == 3:
                self.set_word(PIT_TFLG, 1)
                self._interrupt(IRQ_PIT)
            while self._converting >= 0 and IRQ_ADC1 in self.enabled:
                self.set_word(ADC_R0, self.analog.get(self._converting, 0))
                self._converting = -1
                self._interrupt(IRQ_ADC1)
            if loop:
                self.call("loop")

    def ask_usb(self, frame: bytes, timeout_ms: float = 50) -> bytes:
        """One request over USB; the answer up to its zero, or what came in time."""
        self._sent.clear()
        self._received += frame
        for _ in range(int(timeout_ms) + 1):
            self.call("loop")
            if 0 in self._sent:
                break
            self.run_ms(1)
        return bytes(self._sent)

    # ---- what acts ----

    def _install(self) -> None:
        reads = {
            **dict.fromkeys((ADC_GC, ADC2_GC), lambda old: old & ~0x80),  # a calibration ends at once
            ADC_HS: lambda old: old | 1,
            TRNG_MCTL: lambda old: old | 1 << 10,
            CYCLES: self._count_cycles,
            **{base + 0x1C: self._flags(i) for i, base in enumerate(ENCODERS)},
        }  # fmt: skip
        for address, change in reads.items():
            self.uc.hook_add(unicorn.UC_HOOK_MEM_READ, self._on_read(change), begin=address, end=address + 3)
        writes: dict[int, Callable[[int], None]] = {
            ADC_HC0: self._convert,
            WDOG3_CNT: self._watchdog_command,
            **{base + 0x1E: self._clear_flags(i) for i, base in enumerate(ENCODERS)},
            **{NVIC_ENABLE + 4 * i: self._enable(i, True) for i in range(5)},
            **{NVIC_DISABLE + 4 * i: self._enable(i, False) for i in range(5)},
            **{port + 0x84: self._drive(port, True) for port in GPIO},
            **{port + 0x88: self._drive(port, False) for port in GPIO},
        }
        for address, act in writes.items():
            self.uc.hook_add(unicorn.UC_HOOK_MEM_WRITE, self._on_write(act), begin=address, end=address + 3)
        for name, answer in {
            "usb_serial_available": lambda: len(self._received),
            "usb_serial_getchar": lambda: self._received.pop(0) if self._received else -1,
            "usb_serial_write_buffer_free": lambda: 4096,
            "usb_serial_write": self._usb_write,
            "usb_serial_flush_output": lambda: 0,
        }.items():
            self.uc.hook_add(
                unicorn.UC_HOOK_CODE, self._instead(answer), begin=self.symbols[name] & ~1,
                end=self.symbols[name] & ~1,
            )  # fmt: skip
        self.uc.mem_write(self.symbols["usb_cdc_line_rtsdtr"], b"\x03")  # a program has the port open

    def _count_cycles(self, _old: int) -> int:
        self._now_cycles += 100  # a loop that waits for time ends
        return self._now_cycles

    def _on_read(self, change: Callable[[int], int]) -> Callable[..., None]:
        return lambda uc, access, address, size, value, data: self.set_word(
            address & ~3, change(self.word(address & ~3))
        )

    def _on_write(self, act: Callable[[int], None]) -> Callable[..., None]:
        return lambda uc, access, address, size, value, data: act(value)

    def _instead(self, answer: Callable[[], int]) -> Callable[..., None]:
        def leave(uc: unicorn.Uc, address: int, size: int, data: object) -> None:
            uc.reg_write(arm_const.UC_ARM_REG_R0, answer() & 0xFFFF_FFFF)
            uc.reg_write(arm_const.UC_ARM_REG_PC, uc.reg_read(arm_const.UC_ARM_REG_LR))

        return leave

    def _usb_write(self) -> int:
        start, size = (self.uc.reg_read(r) for r in (arm_const.UC_ARM_REG_R0, arm_const.UC_ARM_REG_R1))
        self._sent += self.uc.mem_read(start, size)
        return int(size)

    def _convert(self, value: int) -> None:
        self._converting = value & 0x1F if value & 0x80 else -1
        if not value & 0x80:  # the core's own analogRead polls for the result
            self.set_word(ADC_R0, self.analog.get(value & 0x1F, 0))

    def _watchdog_command(self, value: int) -> None:
        if value == 0xD928_C520:
            self.set_word(WDOG3_CS, self.word(WDOG3_CS) | 1 << 11)
        elif value == 0xB480_A602:
            self.refreshed += 1

    def _flags(self, decoder: int) -> Callable[[int], int]:
        """CTRL2, whose flags are cleared by writing ones."""
        return lambda old: old & ~(0x08A0 << 16) | (0x0800 << 16 if decoder in self.both_changed else 0)

    def _clear_flags(self, decoder: int) -> Callable[[int], None]:
        def act(value: int) -> None:
            if value & 0x0800:
                self.both_changed.discard(decoder)

        return act

    def _enable(self, index: int, on: bool) -> Callable[[int], None]:
        def act(value: int) -> None:
            numbers = {32 * index + bit for bit in range(32) if value >> bit & 1}
            self.enabled = self.enabled | numbers if on else self.enabled - numbers

        return act

    def _drive(self, port: int, high: bool) -> Callable[[int], None]:
        def act(value: int) -> None:
            level = self.word(port)
            self.set_word(port, level | value if high else level & ~value)

        return act
