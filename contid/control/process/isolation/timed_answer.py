"""Waits for an answer of a kept process, in the time that the process itself takes for it."""

from __future__ import annotations

import time
from typing import Final

from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.process_time import ProcessTime

#: The time for an answer is waited for in this many parts. Most answers come in half of them: whether the
#: process waits for a processor is not asked before.
PARTS: Final = 8
#: Shortest part [s].
_LEAST_S: Final = 2e-4


class AnswerTimer:
    """The answers of one kept process; waiting for a processor is no fault of what computes in it."""

    def __init__(self, link: KeptProcess) -> None:
        self._link = link
        self._process = ProcessTime(0)

    def close(self) -> None:
        """No answer is waited for any more."""
        self._process.close()

    def wait(self, own_s: float, most_s: float) -> bytes | None:
        """The answer to the newest request, None without one.

        A part that takes longer than it was to take counts as what it was to take: this process stood still,
        or waited for a processor.

        Args:
            own_s: longest time, without that in which the process waits for a processor or this one stands
                still.
            most_s: longest time without that in which this one stands still, at least ``own_s``.
        """
        part_s = max(own_s / PARTS, _LEAST_S)
        had_s = passed_s = 0.0
        is_counted, before_s = False, time.monotonic()
        while self._link.state is not ProcessState.ENDED:
            is_over = had_s >= own_s or passed_s >= most_s
            # This process may have waited for a processor too: an answer that is there by now is taken.
            answer = self._link.answer(0.0 if is_over else part_s)
            if answer is not None or is_over:
                return None if answer is None else answer.body
            waited_s = self._process.waited_s() if is_counted else 0.0
            now_s = time.monotonic()
            took_s, before_s = now_s - before_s, now_s
            counted_s = min(took_s, part_s)
            passed_s += counted_s
            had_s += max(counted_s - waited_s, 0.0)
            if not is_counted and had_s >= 0.5 * own_s:
                is_counted = True
                self._count_waiting()
        return None

    def _count_waiting(self) -> None:
        if self._link.pid != self._process.pid:
            self._process.close()
            self._process = ProcessTime(self._link.pid)
        self._process.begin()
