"""A policy as the controller of a running robot: what it sees becomes a row of a live stream, at its rate.

The network runs in a thread of its own. An answer that is not there within its share of the period is
stale: it is never used, the row of that period asks for what was asked last, and so the robots hold. The
next observation is given once the late answer has come. Numbers that are not finite, and rows that are
refused, hold in the same way (`contid_learn.views`). Over a network a refusal comes with a later row; it
takes back what was asked last, not what was refused.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.remote.client.servo import ServoState
from contid_learn.views import Observation, RobotView, Seen, TipGoal, asked_after, observation, row_of

#: Share of the period that an answer may take.
ANSWER_SHARE: Final = 0.6


@dataclass(slots=True)
class LoopCounts:
    """What became of the actions.

    Attributes:
        used: actions of finite numbers, which moved a target.
        stale: periods whose answer came too late.
        not_finite: answers with a number that is not finite.
        refused: rows that were refused.
    """

    used: int = 0
    stale: int = 0
    not_finite: int = 0
    refused: int = 0

    def __str__(self) -> str:
        """One line for the terminal."""
        held = f"held: {self.stale} stale, {self.not_finite} not finite, {self.refused} refused"
        return f"{self.used} actions; {held}"


class Inference:
    """A network in a thread: one observation under way, and no answer is used late.

    Args:
        network: from an observation to an action.
    """

    def __init__(self, network: Callable[[Observation], Array]) -> None:
        self._network = network
        self._questions: SimpleQueue[Observation | None] = SimpleQueue()
        self._answers: SimpleQueue[Array | Exception] = SimpleQueue()
        self._busy = False
        self._thread = threading.Thread(target=self._work, name="policy", daemon=True)
        self._thread.start()

    def ask(self, observed: Observation, timeout_s: float) -> Array | None:
        """The action to an observation; None when it is not there in time, or an older one is still due.

        Args:
            observed: for the network.
            timeout_s: longest wait for its answer.

        Raises:
            Exception: the network raised it.
        """
        if self._busy:
            if self._answer(0.0) is None:
                return None
            self._busy = False  # that was a stale answer
        self._questions.put(observed)
        self._busy = True
        answer = self._answer(timeout_s)
        self._busy = answer is None
        return answer

    def close(self) -> None:
        """End the thread once its network has answered."""
        self._questions.put(None)

    def _answer(self, timeout_s: float) -> Array | None:
        try:
            answer = self._answers.get(timeout=timeout_s) if timeout_s > 0.0 else self._answers.get_nowait()
        except Empty:
            return None
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _work(self) -> None:
        while (observed := self._questions.get()) is not None:
            try:
                self._answers.put(self._network(observed))
            except Exception as error:  # raised where the answer is taken
                self._answers.put(error)


class PolicyLoop:
    """The controller of `contid.Client.servo`.

    Args:
        views: the robots of the file, at the rate of the policy.
        network: from an observation to an action.
        goals: by robot, where the tip is to be and stays, shape ``(d,)``, in the unit of the robot file.
        period_s: of the policy.
        duration_s: after which it ends; None: never.

    Attributes:
        counts: what became of the actions.
    """

    def __init__(
        self,
        views: Sequence[RobotView],
        network: Callable[[Observation], Array],
        goals: Mapping[str, Array],
        period_s: float,
        duration_s: float | None = None,
    ) -> None:
        self._views = views
        self._goals = {name: TipGoal(tip, np.zeros_like(tip)) for name, tip in goals.items()}
        self._inference = Inference(network)
        self._timeout_s = ANSWER_SHARE * period_s
        self._duration_s = duration_s
        self._asked: dict[str, Array] = {}
        self._before: dict[str, Array] = {}
        self.counts = LoopCounts()

    def __enter__(self) -> Self:
        """`close` on leaving."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """`close`."""
        self.close()

    def close(self) -> None:
        """End the thread of the network, once it has answered."""
        self._inference.close()

    def __call__(self, state: ServoState) -> Mapping[str, float] | None:
        """The row of a period; None at the end."""
        if self._duration_s is not None and state.time_s >= self._duration_s:
            return None
        seen = {view.name: seen_of(view, state.robots[view.name]) for view in self._views}
        if not self._asked:
            self._asked = {view.name: view.begin(seen[view.name].measured) for view in self._views}
        elif state.refused:
            self.counts.refused += 1
            self._asked = self._before
        self._before = self._asked
        action = self._inference.ask(
            observation(self._views, seen, self._asked, self._goals), self._timeout_s
        )
        if action is None:
            self.counts.stale += 1
        else:
            if np.isfinite(action).all():
                self.counts.used += 1
            else:
                self.counts.not_finite += 1
            self._asked = asked_after(self._views, self._asked, action)
        return row_of(self._views, self._asked)


def seen_of(view: RobotView, telemetry: Mapping[str, Any]) -> Seen:
    """What telemetry has of a robot: its measured axes, and its tip by a tracker, else by the model.

    Raises:
        ContidError: its axes have no sample yet.
    """
    measured, tip = telemetry.get("measured"), telemetry.get("measured_tip_mm") or telemetry.get("tip_mm")
    if measured is None or tip is None:
        raise ContidError(f"{view.name}: its axes have no sample; a policy begins when robots are armed")
    axes = np.array(measured[: len(view.columns)], dtype=np.float64)
    return Seen(axes, np.array(tip[: view.dimension], dtype=np.float64))
