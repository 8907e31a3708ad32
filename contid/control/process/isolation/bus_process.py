"""The process of a bus: imports its driver, opens the bus and carries out jobs until its socket closes."""

from __future__ import annotations

import gc
import json
import logging
import os
import pickle
import resource
import signal
import socket
import sys
import time
from contextlib import suppress
from typing import Any, Final

from contid.control.engine.cycle import RealClock
from contid.control.engine.ports import BusReply, perform
from contid.control.process.isolation.body import BusBody
from contid.control.process.isolation.output import PipeHandler
from contid.control.process.isolation.wire import HEAD, LONGEST, LONGEST_TEXT, BusAnswer, BusRequest, BusWire
from contid.control.process.realtime import PRIORITY
from contid.errors import ContidError
from contid.hal import Bus, CountsAnswers, LimitsEffort, MeasuresTips, Rest

#: Longest time that a driver may compute at real-time priority without a pause [us]; the kernel then ends it.
LONGEST_RUN_US: Final = 500_000
#: Niceness of what has no real-time priority beside something that has.
NICENESS: Final = 10
#: Largest share of a processor at real-time priority. With 95 % of one (``sched_rt_runtime_us``) the kernel
#: stops everything of that priority there for 50 ms, the tick as well.
MOST_SHARE: Final = 0.5

log = logging.getLogger(__name__)


class BusProcess:
    """The bus, from the first request to the last."""

    def __init__(self, connection: socket.socket, body: bytes) -> None:
        self._connection = connection
        self._packed = body
        self._bus: Bus | None = None
        self._wire: BusWire | None = None
        self._rests: dict[str, Rest] = {}
        self._hurried = False
        self._ran_s = self._looked_s = 0.0
        self._pid = os.getpid()

    def serve(self) -> None:
        """Answer requests until the control process closes the bus, or dies."""
        # A control process that dies during a job, or before it takes an answer, is an error of the socket.
        with suppress(ConnectionError):
            while message := self._connection.recv(LONGEST):
                # A copy of the process that the driver made must not use the bus.
                if os.getpid() != self._pid:
                    os._exit(0)
                kind, number = HEAD.unpack_from(message)
                answer = self._answer(BusRequest(kind), message[HEAD.size :])
                if os.getpid() != self._pid:
                    os._exit(0)
                if answer is not None:
                    self._connection.send(HEAD.pack(answer.kind, number) + answer.body)
                self._look()
                if kind == BusRequest.CLOSE:
                    return
        self._rest()

    def _rest(self) -> None:
        """The control process died, and no watchdog of a device stops what it moved."""
        for rest in set(self._rests.values()):
            axes = [axis for axis, own in self._rests.items() if own is rest]
            with suppress(Exception):
                if self._bus is not None:
                    self._bus.disable(axes, rest)

    def _answer(self, kind: BusRequest, body: bytes) -> BusAnswer | None:
        match kind:
            case BusRequest.JOB:
                return self._job(body)
            case BusRequest.OPEN:
                return _json(kind, self._open())
            case BusRequest.COUNTS:
                return _json(kind, self._counts())
            case BusRequest.EFFORT:
                self._limit_effort(json.loads(body))
                return None
            case BusRequest.CLOSE:
                self._close()
                return _json(kind, {})

    def _counts(self) -> dict[str, Any]:
        try:
            bus = self._build()
            counts = bus.answer_counts() if isinstance(bus, CountsAnswers) else {}
            return {what: int(count) for what, count in counts.items()}
        except Exception as error:
            log.warning("nothing is counted: %s", _defect(error))
            return {}

    def _limit_effort(self, shares: dict[str, float]) -> None:
        try:
            bus = self._build()
            if isinstance(bus, LimitsEffort):
                bus.limit_effort(shares)
        except Exception as error:
            log.warning("the effort is not limited: %s", _defect(error))

    def _close(self) -> None:
        if self._bus is not None:
            with suppress(Exception):
                self._bus.close()

    def _build(self) -> Bus:
        if self._bus is None:
            body: BusBody = pickle.loads(self._packed)
            self._bus = body.build(RealClock())
            self._wire = BusWire([axis.name for axis in body.axes])
            self._rests = body.rests
        return self._bus

    def _open(self) -> dict[str, Any]:
        """Open the bus; what it can beside exchanges, or why it is not open."""
        try:
            bus = self._build()
            bus.open()
            effort = dict(bus.effort_limits()) if isinstance(bus, LimitsEffort) else None
        except ContidError as error:
            return {"error": str(error)[:LONGEST_TEXT], "exit_code": error.exit_code}
        except (Exception, SystemExit) as error:
            return {"error": _defect(error)}
        self._hurry()
        return {
            "counts": isinstance(bus, CountsAnswers),
            "tips": isinstance(bus, MeasuresTips),
            "effort": effort,
        }

    def _job(self, body: bytes) -> BusAnswer:
        extra: dict[str, Any] = {}
        try:
            bus = self._build()
        except (Exception, SystemExit) as error:
            return _json(BusRequest.OPEN, {"error": _defect(error)})
        assert self._wire is not None
        try:
            reply = perform(bus, self._wire.job_of(body))
        except BaseException as error:  # here it costs no other bus
            reply = BusReply(lost=f"{bus.name}: {_defect(error)}")
        if not reply.lost:
            self._hurry()
        if isinstance(bus, MeasuresTips):
            try:
                tips = [[tip.robot, tip.tip_in_world_m, tip.time_s] for tip in bus.measured_tips()]
            except Exception as error:
                reply = BusReply(lost=f"{bus.name}: {_defect(error)}")
            else:
                extra = {"tips": tips} if tips else {}
        return BusAnswer(BusRequest.JOB, self._wire.reply(reply, extra))

    def _hurry(self) -> None:
        """Once the bus is open: real-time priority below the tick, and not for what the driver starts."""
        if self._hurried:
            return
        self._hurried = True
        gc.freeze()
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY - 1))
            os.nice(NICENESS)  # of what the driver starts, and of this process without real-time priority
            self._looked_s, self._ran_s = time.monotonic(), time.thread_time()
            resource.setrlimit(resource.RLIMIT_RTTIME, (LONGEST_RUN_US, 2 * LONGEST_RUN_US))

    def _look(self) -> None:
        """Give up real-time priority when the bus computes most of the time: the kernel would stop others."""
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
            log.warning("the driver computes %.0f %% of the time: no real-time priority", 100.0 * share)


def _defect(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"[:LONGEST_TEXT]


def _json(kind: BusRequest, fields: dict[str, Any]) -> BusAnswer:
    return BusAnswer(kind, json.dumps(fields).encode())


def main(connection: int, output: int, body: bytes) -> int:
    """Serve a bus in this process, which a keeper has forked; returns its exit code.

    Args:
        connection: descriptor of the socket to the control process.
        output: descriptor of the pipe for what it prints and logs.
        body: the pickled `BusBody`.
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
    with socket.socket(fileno=keep) as served:
        BusProcess(served, body).serve()
    return 0
