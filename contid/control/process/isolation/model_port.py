"""The port of a model in a process of its own, and what the tick has instead of that model.

A question waits for its answer: the tick needs it. What becomes of the process:

    state       of the process                                    leads to
    BUILDS      it builds the model; a question is a fault        READY: it has built it; FAILED
    READY       a question is sent and answered, or is a fault    BUILDS, anew: it ended, or was too slow
    FAILED      it cannot build it; a question is a fault         BUILDS, anew, at the next question

Before the first tick a question may take long, and an error is that of the run.
"""

from __future__ import annotations

import enum
import json
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from threading import Lock
from typing import Any, Final

from contid.control.engine.tick_costs import TickCosts, UnansweredError
from contid.control.process.isolation.body import with_isolated_models
from contid.control.process.isolation.isolated_model import IsolatedModel
from contid.control.process.isolation.link import KeptProcess, ProcessState
from contid.control.process.isolation.model_process import ModelProcess
from contid.control.process.isolation.model_wire import ModelQuestion, unpack_answer
from contid.control.process.isolation.process_time import ProcessTime, Waiting
from contid.control.process.isolation.wire import RequestKind
from contid.control.process.tick_alarm import LONGEST_S
from contid.control.tick.faults import Fault
from contid.errors import ContidError
from contid.kinematics.isolated_robot import IsolatedRobot
from contid.robot_file.load import LoadedFile

#: Longest time to build a model, and longest answer before the first tick.
BUILD_S: Final = 10.0
#: Time until a model that failed beside the ticks is built again.
PAUSE_S: Final = 5.0
#: Share of a period for one question; the rest is for the robots beside.
SHARE: Final = 0.5
#: Longest wait for an answer of a process that waits for a processor, in longest answers; at least
#: `LONGEST_S`.
WAITS: Final = 20.0
#: Shortest wait while a process waits for a processor [s].
_LEAST_S: Final = 2e-4


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

    def __init__(self, name: str, robot: IsolatedRobot, *, in_ticks: bool) -> None:
        """Fork the keeper of the process, and let it begin to build the model of a robot.

        Args:
            name: of the robot.
            robot: its description.
            in_ticks: ticks ask the model; else its process gets no priority.
        """
        self.state = ModelState.BUILDS
        self.longest_s = BUILD_S
        self._name = name
        self._robot = robot
        self._in_ticks = in_ticks
        self._why, self._fault = "", Fault.MODEL_ENDED  # it is not ready
        self._lock = Lock()  # the daemon checks trajectories in a thread
        self._failed_s = -math.inf
        self._costs: TickCosts | None = None
        self._process = ProcessTime(0)
        self._link = KeptProcess(name, ModelProcess, robot.body)
        self._build()

    def _build(self) -> None:
        self.state = ModelState.BUILDS
        self._link.start_process()
        self._link.request(RequestKind.OPEN, b"1" if self._in_ticks else b"")

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
        """The run begins: from now on what the model does is a fault of its robot, and may not take long."""
        self._costs, self.longest_s = costs, longest_s

    def close(self) -> None:
        """End the process, which has no devices to bring to rest, at once: it may hang."""
        self._link.end_process("was closed")
        self._link.close(0.0)
        self._process.close()

    def ask(self, brief: bool, method: str, *arguments: Any) -> Any:
        """What the model answers.

        Raises:
            ModelRaisedError: the model raised an error; its class has the name of that.
            UnansweredError: it does not answer, inside a tick.
            ModelLostError: the same, outside.
        """
        with self._lock:
            return self._asked(brief, method, arguments)

    def _asked(self, brief: bool, method: str, arguments: Sequence[Any]) -> Any:
        if self.state is not ModelState.READY and not self._look():
            if self.state is ModelState.FAILED and time.monotonic() - self._failed_s > PAUSE_S:
                self._build()
            raise self._error("; it is being built again" if self.state is ModelState.BUILDS else "")
        self._link.request(RequestKind.ASK, ModelQuestion(brief, method, arguments).pack())
        try:
            answer = self._answer()
        except UnansweredError as error:  # the alarm of the tick came first
            self._why, self._fault = str(error), Fault.MODEL_TOO_SLOW
            self._build()
            raise
        if answer is not None:
            return unpack_answer(answer)
        ended = self._link.state is not ProcessState.RUNS or self._link.is_ending()
        if ended:
            self._note_end()
        else:
            self._why = f"its model did not answer within {self.longest_s * 1e3:.3g} ms"
            self._fault = Fault.MODEL_TOO_SLOW
        failure = self._error()  # no alarm interrupts what follows
        if self._in_ticks:
            self._build()
        else:  # a model that hangs may not hold the daemon most of the time
            self.state, self._failed_s = ModelState.FAILED, time.monotonic()
            self._link.end_process(self._why)
        raise failure

    def _answer(self) -> bytes | None:
        """The answer, None when there is none in time; waiting for a processor is no fault of a model.

        Whether the process waits is not asked before half of the time has passed: most answers are there.
        """
        link, began_s = self._link, time.monotonic()
        if (answer := link.answer(0.5 * self.longest_s)) is not None:
            return answer.body
        half_s = time.monotonic() - began_s
        waiting = self._waiting()
        timeout_s = max(self.longest_s - half_s, _LEAST_S)
        while (answer := link.answer(timeout_s)) is None and link.state is not ProcessState.ENDED:
            passed_s = time.monotonic() - began_s
            timeout_s = self.longest_s - passed_s + waiting(passed_s - half_s)
            if timeout_s <= 0.0 or passed_s > max(LONGEST_S, WAITS * self.longest_s):
                answer = link.answer(0.0)  # this process may itself have waited for a processor
                break
            timeout_s = max(timeout_s, _LEAST_S)
        return None if answer is None else answer.body

    def _waiting(self) -> Waiting:
        """How long the process waits for a processor, from now on."""
        pid = self._link.pid
        if pid != self._process.pid:
            self._process.close()
            self._process = ProcessTime(pid)
        return self._process.waiting()

    def tend(self) -> None:
        """Take what its keeper reports, and note when a model that was begun to be built is ready."""
        if self.state is ModelState.READY:
            self._link.answer(0.0)
            if self._link.state is ProcessState.ENDED:
                self._note_end()
                self._build()
        else:
            self._look()

    def _note_end(self) -> None:
        self._why = f"the process of its model {self._link.how_ended or 'has ended'}"
        self._fault = Fault.MODEL_ENDED

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

    def _error(self, beside: str = "") -> BaseException:
        """The error of a question: in a tick or an order that of its robot, whatever catches errors."""
        if self._costs is not None and self._costs.running >= 0:
            self._costs.running = -1
            return UnansweredError(f"{self._why}{beside}", self._fault)
        return ModelLostError(f"robot {self._name}: {self._why}{beside}")


def model_ports(loaded: LoadedFile, *, in_ticks: bool) -> list[ModelPort]:
    """A port of every isolated model of a file; forks, so before threads and real-time priority."""
    return [
        ModelPort(name, robot, in_ticks=in_ticks)
        for name, robot in loaded.file.robots.items()
        if isinstance(robot, IsolatedRobot)
    ]


def begin_ticks(models: Sequence[ModelPort], costs: TickCosts, rate_hz: float) -> None:
    """Bound the answers of all models from the first tick on.

    A robot alone has no robot beside it that could be late, and the time of any tick.
    """
    alone = len(costs.robots_s) == 1
    for model in models:
        model.begin_ticks(costs, LONGEST_S if alone else SHARE / rate_hz)


@contextmanager
def models_beside(loaded: LoadedFile, longest_s: float = BUILD_S) -> Iterator[LoadedFile]:
    """The robot file with every model of others in a process of its own, for what asks them beside a tick.

    Args:
        loaded: the robot file.
        longest_s: longest answer.

    Raises:
        ModelLostError: one cannot be built.
    """
    isolated = with_isolated_models(loaded)
    with ExitStack() as stack:
        ports = model_ports(isolated, in_ticks=False)
        for port in ports:
            stack.callback(port.close)
        for port in ports:
            port.finish_building()
            port.longest_s = longest_s
        yield isolated
