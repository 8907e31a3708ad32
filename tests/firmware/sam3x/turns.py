"""Skips the turns of a loop that waits: a turn that changes nothing is the same until something happens.

A turn is rehearsed: it runs with every access to a peripheral refused that would change something or depends
on the time. Where registers and memory are afterwards what they were, the processor repeats the turn until
the next event, and only the part of a turn is run in which that event finds it. Everything else is put back.
The processor is in every bit where it would be without (`test_turns.py`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import unicorn
from unicorn import arm_const

if TYPE_CHECKING:
    from tests.firmware.sam3x.cpu import Cpu

#: Instructions of the longest turn that is looked for.
LONGEST = 256
#: Most instructions of an IT block.
IT_BLOCK = 4
#: Most quanta without a look after looks that found no turn, and looks without a search after a search.
PAUSE, SEARCH_PAUSE = 8, 4096
_REGISTERS: Final = (
    *(getattr(arm_const, f"UC_ARM_REG_R{number}") for number in range(13)),
    arm_const.UC_ARM_REG_SP, arm_const.UC_ARM_REG_LR, arm_const.UC_ARM_REG_PC, arm_const.UC_ARM_REG_XPSR,
    arm_const.UC_ARM_REG_PRIMASK, arm_const.UC_ARM_REG_BASEPRI, arm_const.UC_ARM_REG_CONTROL,
)  # fmt: skip
_memcmp = ctypes.CDLL(None).memcmp
_memcmp.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)


@dataclass(frozen=True)
class Turn:
    """One way round the loop from an instruction to itself.

    Attributes:
        length: instructions, as unicorn counts them.
        stops: where a run of each length below `length` stops. It is that length but for an IT block, which
            unicorn leaves only at its end.
        reads: addresses that it reads from peripherals.
    """

    length: int
    stops: Sequence[int]
    reads: tuple[int, ...]

    def begun_at(self, start: int, reads: int) -> Turn:
        """The same turn from another of its instructions, before which it has read some times."""
        order = [(start + i) % self.length for i in range(self.length)]
        stops = [(self.stops[at] - start) % self.length for at in order]
        return Turn(self.length, stops, self.reads[reads:] + self.reads[:reads])

    def after(self, steps: Iterable[int]) -> int:
        """Where the last of several runs one after the other stops."""
        at, stops, length = 0, self.stops, self.length
        for step in steps:
            at = stops[(at + step) % length]
        return at


@dataclass
class Rehearsal:
    """What a turn did: its reads of peripherals, and whether it did what a turn that waits does not."""

    reads: list[int] = field(default_factory=list)
    refused: bool = False


class Turns:
    """The turns of one processor. ``skipped`` counts the cycles that were not emulated."""

    def __init__(self, cpu: Cpu, memory: ctypes.Array[ctypes.c_char]) -> None:
        self._cpu = cpu
        self._memory = memory
        self.rehearsal: Rehearsal | None = None
        self.skipped = 0
        self._known: dict[int, list[Turn]] = {}
        self._failed = self._pause = 0
        self._searched = self._search_after = 0
        self._before = cpu.uc.context_save()
        self._memory_before = ctypes.create_string_buffer(len(memory))
        self._values = (ctypes.c_uint64 * len(_REGISTERS))()
        at = ctypes.addressof(self._values)
        self._pointers = (ctypes.c_void_p * len(_REGISTERS))(*(at + 8 * i for i in range(len(_REGISTERS))))
        self._names = (ctypes.c_int * len(_REGISTERS))(*_REGISTERS)

    def refuses(self) -> bool:
        """Whether an access that changes something has to be left out; the rehearsal ends with it."""
        if self.rehearsal is None:
            return False
        self.rehearsal.refused = True
        self._cpu.uc.emu_stop()
        return True

    def skip(self, pc: int, steps: Callable[[], Iterable[int]]) -> int | None:
        """Run steps of some instructions each, where the loop only waits; the instruction after them.

        ``None`` where it does not wait: nothing has happened.
        """
        known = self._known.get(pc, ())
        self._search_after -= 1
        if self._pause or not (known or self._search_after < 0):
            self._pause = max(0, self._pause - 1)
            return None
        registers = self._registers()
        ctypes.memmove(self._memory_before, self._memory, len(self._memory))
        self._cpu.uc.context_update(self._before)
        turn = self._repeats(pc, known, registers)
        if turn is None and self._search_after < 0:
            turn = self._search(pc, registers)
        if turn is None:
            self._pause = min(self._failed, PAUSE)
            self._failed += 1
            return None
        self._failed = 0
        left = turn.after(steps())
        # A run of one instruction is another mode of unicorn, in which an IT block counts as one.
        self._run(pc, left if left != 1 else left + turn.length)
        end: int = self._cpu.uc.reg_read(arm_const.UC_ARM_REG_PC)
        return end

    def _repeats(self, pc: int, known: Sequence[Turn], registers: bytes) -> Turn | None:
        """Which of the known turns the loop makes from here."""
        for turn in known:
            seen = self._rehearse(pc, turn.length)
            if not seen.refused and self._is_as(registers) and tuple(seen.reads) == turn.reads:
                return turn
            self._put_back()
        return None

    def _search(self, pc: int, registers: bytes) -> Turn | None:
        """Find a turn by running one instruction more each time."""
        self._searched = self._search_after = min(2 * self._searched + 16, SEARCH_PAUSE)
        whole = self._rehearse(pc, LONGEST)
        self._put_back()
        if whole.refused:
            return None
        ends, reads = [registers], [0]
        found: Turn | None = None
        for length in range(1, LONGEST):
            seen = self._rehearse(pc, length)
            ends.append(self._registers())
            reads.append(len(seen.reads))
            same = self._is_as(registers)
            self._put_back()
            if same:  # an IT block that ends here stops shorter runs here, too
                found = Turn(length, _stops(ends[:-1]), tuple(seen.reads))
            elif found is not None:
                break
            if found is not None and length == found.length + IT_BLOCK:
                break
        if found is not None:
            self._searched = 0
            for at in sorted(set(found.stops)):
                self._known.setdefault(_pc(ends[at]), []).insert(0, found.begun_at(at, reads[at]))
        return found

    def _rehearse(self, pc: int, instructions: int) -> Rehearsal:
        self.rehearsal = seen = Rehearsal()
        try:
            self._run(pc, instructions)
        except unicorn.UcError:  # the end of an exception, or a fault: the processor meets it itself
            seen.refused = True
        finally:
            self.rehearsal = None
        return seen

    def _run(self, pc: int, instructions: int) -> None:
        if instructions:
            self._cpu.uc.emu_start(pc | 1, 0xFFFF_FFF8, count=instructions)

    def _registers(self) -> bytes:
        self._cpu.uc._do_reg_read_batch(self._names, self._pointers, len(_REGISTERS))
        return bytes(self._values)

    def _is_as(self, registers: bytes) -> bool:
        """Whether registers and memory are what they were."""
        same = self._registers() == registers
        return same and _memcmp(self._memory, self._memory_before, len(self._memory)) == 0

    def _put_back(self) -> None:
        self._cpu.uc.context_restore(self._before)
        ctypes.memmove(self._memory, self._memory_before, len(self._memory))


def _stops(ends: Sequence[bytes]) -> list[int]:
    """Where runs stop, by the registers after runs of 0, 1, ... instructions."""
    stops = list(range(len(ends)))
    for length in reversed(range(len(ends) - 1)):
        if ends[length] == ends[length + 1]:
            stops[length] = stops[length + 1]
    return stops


def _pc(registers: bytes) -> int:
    at = 8 * _REGISTERS.index(arm_const.UC_ARM_REG_PC)
    return int.from_bytes(registers[at : at + 8], "little")
