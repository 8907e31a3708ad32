"""The process of a bus: imports its driver, opens the bus and carries out jobs until its socket closes."""

from __future__ import annotations

import json
import logging
import pickle
import socket
from contextlib import suppress
from typing import Any

from contid.control.engine.cycle import RealClock
from contid.control.engine.ports import BusReply, perform
from contid.control.process.isolation.body import BusBody
from contid.control.process.isolation.served_process import ServedProcess, defect, json_answer
from contid.control.process.isolation.wire import LONGEST_TEXT, BusWire, KeptAnswer, RequestKind
from contid.errors import ContidError
from contid.hal import Bus, CountsAnswers, LimitsEffort, MeasuresTips, Rest

log = logging.getLogger(__name__)


class BusProcess(ServedProcess):
    """The bus, from the first request to the last."""

    what = "bus"

    def __init__(self, connection: socket.socket, body: bytes) -> None:
        """See `ServedProcess`; ``body`` is the pickled `BusBody`."""
        super().__init__(connection, body)
        self._bus: Bus | None = None
        self._wire: BusWire | None = None
        self._rests: dict[str, Rest] = {}

    def _rest(self) -> None:
        """The control process died, and no watchdog of a device stops what it moved."""
        for rest in set(self._rests.values()):
            axes = [axis for axis, own in self._rests.items() if own is rest]
            with suppress(Exception):
                if self._bus is not None:
                    self._bus.disable(axes, rest)

    def _answer(self, kind: RequestKind, body: bytes) -> KeptAnswer | None:
        match kind:
            case RequestKind.JOB:
                return self._job(body)
            case RequestKind.OPEN:
                return json_answer(kind, self._open())
            case RequestKind.COUNTS:
                return json_answer(kind, self._counts())
            case RequestKind.EFFORT:
                self._limit_effort(json.loads(body))
                return None
            case _:
                self._close()
                return json_answer(kind, {})

    def _counts(self) -> dict[str, Any]:
        try:
            bus = self._build()
            counts = bus.answer_counts() if isinstance(bus, CountsAnswers) else {}
            return {what: int(count) for what, count in counts.items()}
        except Exception as error:
            log.warning("nothing is counted: %s", defect(error))
            return {}

    def _limit_effort(self, shares: dict[str, float]) -> None:
        try:
            bus = self._build()
            if isinstance(bus, LimitsEffort):
                bus.limit_effort(shares)
        except Exception as error:
            log.warning("the effort is not limited: %s", defect(error))

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
            return {"error": defect(error)}
        self._hurry()
        return {
            "counts": isinstance(bus, CountsAnswers),
            "tips": isinstance(bus, MeasuresTips),
            "effort": effort,
        }

    def _job(self, body: bytes) -> KeptAnswer:
        extra: dict[str, Any] = {}
        try:
            bus = self._build()
        except (Exception, SystemExit) as error:
            return json_answer(RequestKind.OPEN, {"error": defect(error)})
        assert self._wire is not None
        try:
            reply = perform(bus, self._wire.job_of(body))
        except BaseException as error:  # here it costs no other bus
            reply = BusReply(lost=f"{bus.name}: {defect(error)}")
        if not reply.lost:
            self._hurry()
        if isinstance(bus, MeasuresTips):
            try:
                tips = [[tip.robot, tip.tip_in_world_m, tip.time_s] for tip in bus.measured_tips()]
            except Exception as error:
                reply = BusReply(lost=f"{bus.name}: {defect(error)}")
            else:
                extra = {"tips": tips} if tips else {}
        return KeptAnswer(RequestKind.JOB, self._wire.reply(reply, extra))
