"""The UOTGHS in device mode, and the host behind it: enumeration, line state, bulk packets.

The host takes a packet ``LATENCY`` after the board offers it, while it reads at all (``reads``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator

from tests.firmware.sam3x.cpu import CLOCK_HZ, Cpu
from tests.firmware.sam3x.system_control import NEVER

IRQ = 40
FIFO, FIFO_STEP, ENDPOINTS = 0x2018_0000, 0x8000, 10
OUT, IN = 2, 3  # the data endpoints of the core's CDC interface
TXINI, RXOUTI, RXSTPI, CFGOK, FIFOCON = 1, 2, 4, 1 << 18, 1 << 14
LATENCY = CLOCK_HZ // 20_000  # 50 us
Steps = Generator[None, None, None]


class Endpoint:
    def __init__(self) -> None:
        self.flags = 0
        self.mask = 0
        self.bank = bytearray()  # the current bank: what is left to read, or was written
        self.queue: deque[bytes] = deque()  # OUT: on the way; IN: waiting for the host


class Usb:
    """``received`` collects bytes from the board, ``packets`` their sizes; ``full_speed`` is the link."""

    def __init__(self, cpu: Cpu, full_speed: bool = False) -> None:
        self._cpu = cpu
        self.full_speed = full_speed
        self.reads = True
        self.received = bytearray()
        self.packets: list[int] = []
        self.lost_packets = 0
        self.opened = False
        self.ends = [Endpoint() for _ in range(ENDPOINTS)]
        self._words: dict[int, int] = {}
        self._interrupts = self._enabled = 0
        self._script: Steps | None = None
        self._control_in = bytearray()
        self.due = NEVER
        cpu.uc.mmio_map(FIFO, FIFO_STEP * ENDPOINTS, self._pop, None, self._push, None)

    # ---- the host ----

    def plug(self) -> None:
        """Enumerate and open the port, as a terminal program does."""
        self._script = self._enumerate()
        self.due = self._cpu.cycles + LATENCY

    def open(self) -> None:
        """The state after enumeration, for a sketch whose core does not enumerate."""
        for number, setting in ((OUT, 0x3066), (IN, 0x3166)):  # bulk, 512 bytes, two banks, allocated
            self.write(0x100 + 4 * number, setting)
        self.opened = True

    def ask_string(self, number: int) -> bytearray:
        """Ask for a string descriptor; it is in the result once the board has run."""
        answer = bytearray()

        def script() -> Steps:
            yield from self._control(bytes((0x80, 6, number, 3, 9, 4, 255, 0)))
            answer.extend(self._control_in)

        self._script = script()
        self._wake()
        return answer

    def send(self, data: bytes) -> None:
        """Bytes to the board, in packets of the link's size."""
        size = 64 if self.full_speed else 512
        for at in range(0, len(data), size):
            self.ends[OUT].queue.append(data[at : at + size])
        self._fill_out()
        self._wake()

    def stall_control(self) -> None:
        """A control transfer begins, and the link is lost: endpoint 0 never gets a free bank."""
        self._load(0, bytes((0x80, 6, 0, 1, 0, 0, 18, 0)))
        self.ends[0].flags = RXSTPI
        self._line()

    def fire(self) -> None:
        self.due = NEVER
        if self._script is not None:
            try:
                next(self._script)
            except StopIteration:
                self._script = None
            self.due = self._cpu.cycles + LATENCY
        end = self.ends[IN]
        if self.reads and end.queue:
            packet = end.queue.popleft()
            self.packets.append(len(packet))
            if self.full_speed and len(packet) > 64:
                self.lost_packets += 1  # babble: the host controller drops it
            else:
                self.received += packet
            end.flags |= TXINI
            if end.queue:
                self.due = self._cpu.cycles + LATENCY
        self._line()

    def _enumerate(self) -> Steps:
        while self._words.get(0x000, 1 << 8) & 1 << 8:  # detached
            yield
        self._interrupts |= 1 << 3  # end of reset
        yield
        while self._interrupts & 1 << 3:
            yield
        yield from self._control(bytes((0x80, 6, 0, 1, 0, 0, 18, 0)))
        yield from self._control(bytes((0, 5, 9, 0, 0, 0, 0, 0)))
        yield from self._control(bytes((0x80, 6, 0, 2, 0, 0, 75, 0)))
        yield from self._control(bytes((0, 9, 1, 0, 0, 0, 0, 0)))
        yield from self._control(bytes((0x21, 0x20, 0, 0, 0, 0, 7, 0)), bytes((0, 194, 1, 0, 0, 0, 8)))
        yield from self._control(bytes((0x21, 0x22, 3, 0, 0, 0, 0, 0)))
        self.opened = True

    def _control(self, setup: bytes, data: bytes = b"") -> Steps:
        end = self.ends[0]
        self._control_in.clear()
        self._load(0, setup)
        end.flags |= RXSTPI | TXINI
        while end.flags & RXSTPI:
            yield
        if data:
            self._load(0, data)
            end.flags |= RXOUTI
            while end.flags & RXOUTI:
                end.flags |= TXINI
                yield
        requested = int.from_bytes(setup[6:8], "little") if setup[0] & 0x80 else 0
        for _ in range(6):  # the status stage, or packets of data
            end.flags |= TXINI
            yield
            if requested and len(self._control_in) >= requested:
                break

    # ---- banks ----

    def _load(self, number: int, data: bytes) -> None:
        self.ends[number].bank[:] = data

    def _fill_out(self) -> None:
        end = self.ends[OUT]
        if end.queue and not end.mask & FIFOCON and self._words.get(0x108, 0):
            self._load(OUT, end.queue.popleft())
            end.flags |= RXOUTI
            end.mask |= FIFOCON
            self._line()

    def _pop(self, _: object, offset: int, size: int, __: object) -> int:
        """The next byte, wherever in the endpoint's window the access is."""
        if self._cpu.refuses():
            return 0
        bank = self.ends[offset // FIFO_STEP].bank
        value = int.from_bytes(bank[:size], "little")
        del bank[:size]
        return value

    def _push(self, _: object, offset: int, size: int, value: int, __: object) -> None:
        if not self._cpu.refuses():
            self.ends[offset // FIFO_STEP].bank += value.to_bytes(size, "little")

    def _take(self, number: int) -> bytes:
        bank = self.ends[number].bank
        data = bytes(bank)
        bank.clear()
        return data

    def _wake(self) -> None:
        self.due = min(self.due, self._cpu.cycles + LATENCY)

    def _line(self) -> None:
        self._cpu.line(IRQ, bool(self._status() & self._enabled))

    def _status(self) -> int:
        status = self._interrupts
        for number, end in enumerate(self.ends):
            if end.flags & end.mask & 0xFF:
                status |= 1 << 12 + number
        return status

    # ---- registers ----

    def keeps(self, offset: int) -> bool:
        return True

    def read(self, offset: int) -> int:
        if offset == 0x804:
            return (0 if self.full_speed else 1) << 12 | 1 << 14
        if offset == 0x004:
            return self._status()
        if offset == 0x010:
            return self._enabled
        if 0x130 <= offset < 0x158:
            end = self.ends[(offset - 0x130) // 4]
            return end.flags | len(end.bank) << 20 | CFGOK
        if 0x1C0 <= offset < 0x1E8:
            return self.ends[(offset - 0x1C0) // 4].mask
        return self._words.get(offset, 1 << 8 if offset == 0 else 0)

    def write(self, offset: int, value: int) -> None:
        self._words[offset] = value
        if offset == 0x008:
            self._interrupts &= ~value
        elif offset == 0x014:
            self._enabled &= ~value
        elif offset == 0x018:
            self._enabled |= value
        elif 0x100 <= offset < 0x128:
            if value & 1 << 8:  # IN: the banks are free
                self.ends[(offset - 0x100) // 4].flags |= TXINI
            self._fill_out()
        elif 0x160 <= offset < 0x188:
            self._clear((offset - 0x160) // 4, value)
        elif 0x1F0 <= offset < 0x218:
            self.ends[(offset - 0x1F0) // 4].mask |= value
        elif 0x220 <= offset < 0x248:
            number = (offset - 0x220) // 4
            end = self.ends[number]
            if value & FIFOCON:
                if number == IN:
                    self._offer()
                elif number == OUT and end.mask & FIFOCON:
                    if end.bank:
                        self.lost_packets += 1  # released before it was read
                    end.bank.clear()
                    end.mask &= ~FIFOCON
            end.mask &= ~value
            self._fill_out()
        self._line()

    def _clear(self, number: int, value: int) -> None:
        end = self.ends[number]
        end.flags &= ~value
        if number == 0 and value & TXINI:
            self._control_in += self._take(0)
            self._wake()

    def _offer(self) -> None:
        end = self.ends[IN]
        end.queue.append(self._take(IN))
        if len(end.queue) < 2:  # two banks
            end.flags |= TXINI
        self._wake()
