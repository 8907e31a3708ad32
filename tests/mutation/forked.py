"""Work in forked processes, within limits of processor time, which hold beside other jobs too."""

from __future__ import annotations

import faulthandler
import json
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NoReturn, TypeVar

#: What a process returns: plain values.
Result = dict[str, Any]
#: Wall-clock time that a process may take, as a multiple of its limit.
BUSY: Final = 30.0

T = TypeVar("T")


class Forked:
    """A process that does some work and returns its result through a pipe.

    Args:
        work: called in the process.
        limit_s: of its processor time; 0 for none.
        log: where its output goes.
    """

    def __init__(self, work: Callable[[], Result], limit_s: float = 0.0, log: str = os.devnull) -> None:
        self._until_s = time.monotonic() + BUSY * limit_s if limit_s else float("inf")
        self._read, write = os.pipe()
        sys.stdout.flush()
        self._process = os.fork()
        if not self._process:
            os.close(self._read)
            _child(work, write, limit_s, log)
        os.close(write)
        os.set_blocking(self._read, False)
        self._text = b""

    def result(self) -> Result | None:
        """The result once the process has ended, None before; without one it has the key ``ended``."""
        try:
            while more := os.read(self._read, 1 << 20):
                self._text += more
        except BlockingIOError:
            if time.monotonic() < self._until_s:
                return None
            os.killpg(self._process, signal.SIGKILL)
        os.close(self._read)
        status = os.waitstatus_to_exitcode(os.waitpid(self._process, 0)[1])
        result: Result = json.loads(self._text) if self._text and not status else {"ended": status}
        return result

    def wait(self) -> Result:
        """The result, when it is there."""
        while (result := self.result()) is None:
            time.sleep(0.1)
        return result


def results(tasks: Iterable[T], start: Callable[[T], Forked], jobs: int) -> Iterator[tuple[T, Result]]:
    """The results of tasks, each in a process of its own, at most ``jobs`` at once."""
    waiting, running = iter(tasks), list[tuple[T, Forked]]()
    while True:
        while len(running) < jobs and (task := next(waiting, None)) is not None:
            running.append((task, start(task)))
        if not running:
            return
        ended = [(task, result) for task, each in running if (result := each.result()) is not None]
        running = [(task, each) for task, each in running if task not in [done for done, _ in ended]]
        yield from ended
        if not ended:
            time.sleep(0.01)


def _child(work: Callable[[], Result], result: int, limit_s: float, log: str) -> NoReturn:
    code = 70
    try:
        os.setsid()
        os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND), 1)
        os.dup2(1, 2)
        faulthandler.disable()
        if limit_s:
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s) + 1, int(limit_s) + 5))
        text = json.dumps(work())
        with os.fdopen(result, "w", encoding="utf-8") as file:
            file.write(text)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
