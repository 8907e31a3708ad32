"""The port of a model in a process of its own, which answers its questions.

    state       of the process                                    leads to
    BUILDS      it builds the model; a question is an error       READY: it has built it; FAILED
    READY       a question is sent and answered, or is an error   BUILDS: it ended or was too slow; FAILED
    FAILED      no model; a question is an error                  BUILDS, at a question `PAUSE_S` later

A question waits for its answer: what asks needs it. An event loop has it asked in a thread
(`contid.control.process.isolation.model_threads`). One that fails in a tick, or in an order, is a fault of
its robot (`UnansweredError`), and the model is built again at once. Before the first tick and beside the
ticks, in the daemon, it is an error of who asks (`ModelLostError`), and the process is ended.
"""

from __future__ import annotations

import enum
import json
import math
import time
from collections.abc import Sequence
from typing import Any, Final

from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.process.isolation.isolated_model import IsolatedModel
from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.model_process import ModelProcess
from contid.control.process.isolation.model_threads import FairLock, check_awaited
from contid.control.process.isolation.model_wire import ModelQuestion, unpack_answer
from contid.control.process.isolation.timed_answer import AnswerTimer
from contid.control.process.isolation.wire import RequestKind
from contid.control.process.tick_alarm import LONGEST_S
from contid.control.tick.faults import Fault
from contid.errors import ContidError
from contid.kinematics.isolated_robot import IsolatedRobot

#: Longest time to build a model, and longest answer before the first tick.
BUILD_S: Final = 10.0
#: Time until a model that failed beside the ticks is built again.
PAUSE_S: Final = 5.0
#: Longest wait for an answer of a process that waits for a processor, in longest answers; at least
#: `LONGEST_S`.
WAITS: Final = 20.0


class ModelLostError(ContidError, ValueError):
    """A model in a process of its own cannot be built, or does not answer.

    It is a ValueError as that of a model without an answer: rows that need it are refused in their place.
    """


class ModelState(enum.Enum):
    """The states of a model; the table is above."""

    BUILDS = enum.auto()
    READY = enum.auto()
    FAILED = enum.auto()


class ModelPort:
    """A model in a process of its own, and its questions.

    Attributes:
        state: of the model.
        longest_s: longest answer; the time in which the process waits for a processor does not count.
    """

    def __init__(self, name: str, robot: IsolatedRobot) -> None:
        """Fork the keeper of the process, and let it begin to build the model of a robot.

        Args:
            name: of the robot.
            robot: its description.
        """
        self.state = ModelState.BUILDS
        self.longest_s = BUILD_S
        self._name = name
        self._robot = robot
        self._why, self._fault = "", Fault.MODEL_ENDED  # of the newest failure
        self._lock = FairLock()  # the daemon asks in threads
        self._failed_s = -math.inf
        self._costs: TickCosts | None = None
        self._link = KeptProcess(name, ModelProcess, robot.body)
        self._timer = AnswerTimer(self._link)
        self._build()

    # -- the process -------------------------------------------------------------------------------------

    def _build(self) -> None:
        """Begin to build the model in a new process; questions of ticks find it hurried."""
        self.state = ModelState.BUILDS
        self._link.start_process()
        self._link.request(RequestKind.OPEN)
        if self._costs is not None:
            self._link.send_unanswered(RequestKind.HURRY, b"")

    def finish_building(self) -> None:
        """Wait until the model is built, and connect its robot to it.

        Raises:
            ModelLostError: it was not built in time, its process ended, or its package raised an error.
        """
        found = self._link.answer_json(BUILD_S - (time.monotonic() - self._link.requested_s))
        if found is None:
            found = {"error": self._link.how_ended or f"was not built within {BUILD_S:g} s"}
        if "error" in found:
            raise ModelLostError(f"robot {self._name}: model {self._robot.model!r}: {found['error']}")
        self.state = ModelState.READY
        self._robot.connect(IsolatedModel(self.ask, found, brief=False))

    def begin_ticks(self, costs: TickCosts, longest_s: float) -> None:
        """The run begins: from now on a failure is a fault of the robot, and no answer may take long.

        Only now its process gets real-time priority, under which the kernel ends what computes for long.
        """
        self._costs, self.longest_s = costs, longest_s
        self._link.send_unanswered(RequestKind.HURRY, b"")

    def tend(self) -> None:
        """Take what its keeper reports, and note when a model that was begun to be built is ready."""
        if self.state is not ModelState.READY:
            self._look()
            return
        self._link.answer(0.0)
        if self._link.state is ProcessState.ENDED:
            self._note_end()
            self._build()

    def close(self) -> None:
        """End the process, which has no devices to bring to rest, at once: it may hang."""
        self._link.end_process("was closed")
        with self._lock:  # a question of a thread has ended with the process
            self.state, self._failed_s, self._why = ModelState.FAILED, math.inf, "its model was closed"
            self._link.close(0.0)
            self._timer.close()

    # -- questions ---------------------------------------------------------------------------------------

    def ask(self, brief: bool, method: str, *arguments: Any) -> Any:
        """What the model answers.

        Raises:
            ModelRaisedError: the model raised an error; its class has the name of that.
            UnansweredError: it does not answer, inside a tick or an order.
            ModelLostError: the same, outside.
        """
        if self._costs is not None:  # in one thread, where an alarm may come between any two lines
            return self._asked(brief, method, arguments)
        with self._lock:
            check_awaited()
            return self._asked(brief, method, arguments)

    def _asked(self, brief: bool, method: str, arguments: Sequence[Any]) -> Any:
        if self.state is not ModelState.READY and not self._look():
            if self.state is ModelState.FAILED and time.monotonic() - self._failed_s > PAUSE_S:
                self._build()
            raise self._error("; it is being built again" if self.state is ModelState.BUILDS else "")
        self._link.request(RequestKind.ASK, ModelQuestion(brief, method, arguments).pack())
        longest_s = self.longest_s
        try:
            answer = self._timer.wait(longest_s, max(LONGEST_S, WAITS * longest_s))
        except UnansweredError as error:  # the alarm of the tick came first
            self._why, self._fault = str(error), Fault.MODEL_TOO_SLOW
            self._build()
            raise
        if answer is not None:
            return unpack_answer(answer)
        raise self._failure()

    def _failure(self) -> BaseException:
        """The error of a question without an answer, and what becomes of the process."""
        if self._link.state is not ProcessState.RUNS or self._link.is_ending():
            self._note_end()
        else:
            self._why = f"its model did not answer within {self.longest_s * 1e3:.3g} ms"
            self._fault = Fault.MODEL_TOO_SLOW
        failure = self._error()  # no alarm interrupts what follows
        if self._costs is not None:
            self._build()
        else:  # a model that hangs may not hold the daemon most of the time
            self.state, self._failed_s = ModelState.FAILED, time.monotonic()
            self._link.end_process(self._why)
        return failure

    def _look(self) -> bool:
        """True when the model that was begun to be built is ready; begins anew when that took too long."""
        link = self._link
        answer = link.answer(0.0)
        if self.state is ModelState.BUILDS:
            found = {} if answer is None else json.loads(answer.body)
            if answer is not None and "error" not in found:
                self.state = ModelState.READY
            elif answer is not None or link.state is ProcessState.ENDED:
                self.state, self._failed_s = ModelState.FAILED, time.monotonic()
                self._fault = Fault.MODEL_ENDED
                self._why = f"its model: {found.get('error') or link.how_ended}"
            elif time.monotonic() - link.requested_s > BUILD_S:
                self._build()
        return self.state is ModelState.READY

    def _note_end(self) -> None:
        self._why = f"the process of its model {self._link.how_ended or 'has ended'}"
        self._fault = Fault.MODEL_ENDED

    def _error(self, beside: str = "") -> BaseException:
        """The error of a question: in a tick or an order that of its robot, whatever catches errors."""
        if self._costs is not None and self._costs.running >= 0:
            self._costs.running = -1
            return UnansweredError(f"{self._why}{beside}", self._fault)
        return ModelLostError(f"robot {self._name}: {self._why}{beside}")
