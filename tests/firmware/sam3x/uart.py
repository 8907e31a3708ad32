"""The UART with its peripheral DMA controller, at the bit rate it is set to; no FIFO, as the chip."""

from __future__ import annotations

from collections import deque

from tests.firmware.sam3x.cpu import Cpu
from tests.firmware.sam3x.system_control import NEVER

RXRDY, TXRDY, ENDRX, ENDTX, OVRE, TXEMPTY, TXBUFE, RXBUFF = (
    1 << bit for bit in (0, 1, 3, 4, 5, 9, 11, 12)
)  # fmt: skip
IRQ = 8


class Uart:
    """``sent`` collects what the board sent; ``overruns`` counts bytes that nothing fetched in time."""

    def __init__(self, cpu: Cpu) -> None:
        self._cpu = cpu
        self.sent = bytearray()
        self.overruns = 0
        self._words: dict[int, int] = {}
        self._status = TXRDY | TXEMPTY
        self._mask = 0
        self._receives = self._sends = False
        self._dma_receives = self._dma_sends = False
        self._incoming: deque[int] = deque()
        self._rx_due = self._tx_due = NEVER
        self._shifting: int | None = None
        self._holding: int | None = None
        self.due = NEVER

    @property
    def byte_cycles(self) -> int:
        return 160 * max(1, self._words.get(0x20, 21))

    def feed(self, data: bytes) -> None:
        """Bytes from the host, back to back from now on."""
        if not self._incoming:
            self._rx_due = self._cpu.cycles + self.byte_cycles
        self._incoming.extend(data)
        self._next()

    def fire(self) -> None:
        if self._rx_due <= self._cpu.cycles:
            byte = self._incoming.popleft()
            self._rx_due = self._rx_due + self.byte_cycles if self._incoming else NEVER
            if self._receives:
                self._arrive(byte)
        if self._tx_due <= self._cpu.cycles:
            if self._shifting is not None:
                self.sent.append(self._shifting)
            self._shifting, self._holding = self._holding, None
            self._tx_due = self._tx_due + self.byte_cycles if self._shifting is not None else NEVER
        self._move()

    def _arrive(self, byte: int) -> None:
        if self._status & RXRDY:
            self.overruns += 1
            self._status |= OVRE
        self._words[0x18] = byte
        self._status |= RXRDY

    def _move(self) -> None:
        """What the DMA controller does at once, and the request line."""
        words = self._words
        if self._dma_receives and self._status & RXRDY and words.get(0x104, 0):
            self._cpu.uc.mem_write(words[0x100], bytes([words[0x18]]))
            self._status &= ~RXRDY
            self._advance(0x100, 0x104, 0x110, 0x114)
        while self._dma_sends and words.get(0x10C, 0) and self._holding is None:
            self._put(self._cpu.uc.mem_read(words[0x108], 1)[0])
            self._advance(0x108, 0x10C, 0x118, 0x11C)
        self._cpu.line(IRQ, bool(self.status() & self._mask))
        self._next()

    def _advance(self, pointer: int, counter: int, next_pointer: int, next_counter: int) -> None:
        words = self._words
        words[pointer] += 1
        words[counter] -= 1
        if words[counter] == 0 and words.get(next_counter, 0):
            words[pointer], words[counter] = words[next_pointer], words[next_counter]
            words[next_counter] = 0

    def _put(self, byte: int) -> None:
        if self._shifting is None:
            self._shifting = byte
            self._tx_due = self._cpu.cycles + self.byte_cycles
        else:
            self._holding = byte
        self._next()

    def _next(self) -> None:
        self.due = min(self._rx_due, self._tx_due)

    def status(self) -> int:
        status = self._status & (RXRDY | OVRE)
        words = self._words
        status |= TXRDY if self._holding is None else 0
        status |= TXEMPTY if self._shifting is None else 0
        status |= ENDTX if not words.get(0x10C, 0) else 0
        status |= TXBUFE if not words.get(0x10C, 0) and not words.get(0x11C, 0) else 0
        status |= ENDRX if not words.get(0x104, 0) else 0
        return status | (RXBUFF if not words.get(0x104, 0) and not words.get(0x114, 0) else 0)

    def keeps(self, offset: int) -> bool:
        return offset != 0x18

    def read(self, offset: int) -> int:
        if offset == 0x14:
            return self.status()
        if offset == 0x10:
            return self._mask
        value = self._words.get(offset, 0)
        if offset == 0x18:
            self._status &= ~RXRDY
            self._cpu.line(IRQ, bool(self.status() & self._mask))
        return value

    def write(self, offset: int, value: int) -> None:
        if offset == 0x00:
            self._receives = bool(value & 0x10) or (self._receives and not value & 0x24)
            self._sends = bool(value & 0x40) or (self._sends and not value & 0x88)
            if value & 0x100:
                self._status &= ~OVRE
        elif offset == 0x08:
            self._mask |= value
        elif offset == 0x0C:
            self._mask &= ~value
        elif offset == 0x1C:
            self._put(value & 0xFF)
        elif offset == 0x120:
            self._dma_receives = bool(value & 1) or (self._dma_receives and not value & 2)
            self._dma_sends = bool(value & 0x100) or (self._dma_sends and not value & 0x200)
        else:
            self._words[offset] = value
        self._move()
