"""A process that answers requests of the control process until its socket closes: of a bus, or of a model.

What is not contid's own runs in it. A keeper (`contid.control.process.isolation.keeper`) has forked it.
"""

from __future__ import annotations

import gc
import json
import logging
import os
import resource
import signal
import socket
import sys
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from typing import Any, ClassVar, Final

from contid.control.process.isolation.output import PipeHandler
from contid.control.process.isolation.wire import HEAD, LONGEST, LONGEST_TEXT, KeptAnswer, RequestKind
from contid.control.process.realtime import PRIORITY

#: Longest time that foreign code may compute at real-time priority without a pause [us]; the kernel then ends
#: its process.
LONGEST_RUN_US: Final = 500_000
#: Niceness of what has no real-time priority beside something that has.
NICENESS: Final = 10
#: Largest share of a processor at real-time priority. With 95 % of one (``sched_rt_runtime_us``) the kernel
#: stops everything of that priority there for 50 ms, the tick as well.
MOST_SHARE: Final = 0.5

log = logging.getLogger(__name__)


class ServedProcess(ABC):
    """What is served, from the first request to the last."""

    #: What computes in it, for its messages.
    what: ClassVar[str]

    def __init__(self, connection: socket.socket, body: bytes) -> None:
        """Serve a connection to the control process; ``body`` is what builds the bus or the model."""
        self._connection = connection
        self._packed = body
        self._hurried = False
        self._ran_s = self._looked_s = 0.0
        self._pid = os.getpid()

    def serve(self) -> None:
        """Answer requests until the control process closes what is served, or dies."""
        # A control process that dies during a job, or before it takes an answer, is an error of the socket.
        with suppress(ConnectionError):
            while message := self._connection.recv(LONGEST):
                # A copy of the process that foreign code made must not answer.
                if os.getpid() != self._pid:
                    os._exit(0)
                kind, number = HEAD.unpack_from(message)
                answer = self._answer(RequestKind(kind), message[HEAD.size :])
                if os.getpid() != self._pid:
                    os._exit(0)
                if answer is not None:
                    self._connection.send(HEAD.pack(answer.kind, number) + answer.body)
                self._look()
                if kind == RequestKind.CLOSE:
                    return
        self._rest()

    @abstractmethod
    def _answer(self, kind: RequestKind, body: bytes) -> KeptAnswer | None:
        """The answer to a request, None for one that has none; raises nothing."""

    def _rest(self) -> None:  # noqa: B027 (a model has no devices)
        """The control process died: bring devices to rest."""

    def _hurry(self) -> None:
        """Once ticks wait for it: real-time priority below theirs, and not for what foreign code starts."""
        if self._hurried:
            return
        self._hurried = True
        gc.freeze()
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY - 1))
            os.nice(NICENESS)  # of what it starts, and of this process without real-time priority
            self._looked_s, self._ran_s = time.monotonic(), time.thread_time()
            resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN_US, 2 * LONGEST_RUN_US))

    def _look(self) -> None:
        """Give up real-time priority when it computes most of the time: the kernel would stop others."""
        now_s = time.monotonic()
        if not self._looked_s or now_s - self._looked_s < 1.0:
            return
        ran_s = time.thread_time()
        share = (ran_s - self._ran_s) / (now_s - self._looked_s)
        self._looked_s, self._ran_s = now_s, ran_s
        if share > MOST_SHARE:
            self._looked_s = 0.0
            # Without CAP_SYS_NICE the kernel refuses to clear the flag that `_hurry` has set (sched(7)).
            os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
            log.warning(
                "the %s computes %.0f %% of the time: no real-time priority", self.what, 100.0 * share
            )


def defect(error: BaseException) -> str:
    """An error of foreign code, for a message."""
    return f"{type(error).__name__}: {error}"[:LONGEST_TEXT]


def json_answer(kind: RequestKind, fields: dict[str, Any]) -> KeptAnswer:
    """An answer in JSON."""
    return KeptAnswer(kind, json.dumps(fields).encode())


def main(served: type[ServedProcess], connection: int, output: int, body: bytes) -> int:
    """Serve in this process, which a keeper has forked; returns its exit code.

    Args:
        served: what to serve.
        connection: descriptor of the socket to the control process.
        output: descriptor of the pipe for what it prints and logs.
        body: of the bus or the model.
    """
    for number in (signal.SIGTERM, signal.SIGCHLD, signal.SIGALRM):
        signal.signal(number, signal.SIG_DFL)
    null = os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    keep = os.dup2(connection, 3)
    os.closerange(4, 1 << 16)
    if sys.__stdout__ is not None:
        sys.__stdout__.reconfigure(line_buffering=True)
    root = logging.getLogger()
    root.handlers[:] = [PipeHandler(2)]
    with socket.socket(fileno=keep) as control:
        served(control, body).serve()
    return 0
