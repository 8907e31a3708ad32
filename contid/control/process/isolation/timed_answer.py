"""Waits for an answer of a kept process, in the time that the process itself takes for it."""

from __future__ import annotations

import time
from typing import Final

from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.process_time import ProcessTime

#: Shortest wait while a process waits for a processor [s].
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

        Args:
            own_s: longest time without that in which the process waits for a processor.
            most_s: longest time, at least that.
        """
        link, began_s = self._link, time.monotonic()
        # Most answers come in half of the time: whether the process waits is not asked before.
        if (answer := link.answer(0.5 * own_s)) is not None:
            return answer.body
        self._count_waiting()
        waited_s = 0.0
        while link.state is not ProcessState.ENDED:
            passed_s = time.monotonic() - began_s
            left_s = min(own_s + waited_s, most_s) - passed_s
            # This process may have waited for a processor too: an answer that is there by now is taken.
            answer = link.answer(max(left_s, _LEAST_S) if left_s > 0.0 else 0.0)
            if answer is not None or left_s <= 0.0:
                return None if answer is None else answer.body
            waited_s += self._process.waited_s()
        return None

    def _count_waiting(self) -> None:
        if self._link.pid != self._process.pid:
            self._process.close()
            self._process = ProcessTime(self._link.pid)
        self._process.begin()
