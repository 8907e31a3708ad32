"""What isolated models answer of a record, for what shows it: asked beside the event loop, and briefly."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Final

from contid.control.engine.tick_layout import TickRecord
from contid.control.process.isolation.model_threads import ModelThreads
from contid.robot_file.load import LoadedFile

#: Longest wait for the answers; what is not answered by then is None.
ANSWER_S: Final = 0.1

_Answers = dict[tuple[str, str], Any]


class ModelAnswers:
    """The fields of a robot that its model answers; those of contid's own models are asked at once.

    Args:
        loaded: the robot file.
        fields: that ask a model.
        value_of: asks for a field of a robot in a record.
    """

    def __init__(
        self, loaded: LoadedFile, fields: frozenset[str], value_of: Callable[[TickRecord, str, str], Any]
    ) -> None:
        self._threads = ModelThreads(loaded)
        self._fields = fields
        self._value_of = value_of
        #: By robot and field, of the record that was asked for last.
        self._answers: _Answers = {}

    def needed(self, robots: Iterable[str], fields: Iterable[str]) -> bool:
        """True when `ask` has to come before `value`."""
        return bool(self._threads.isolated(robots)) and not self._fields.isdisjoint(fields)

    async def ask(self, record: TickRecord | None, robots: Iterable[str], fields: Iterable[str]) -> None:
        """Ask for fields of a record.

        They stand until the next call, so what uses them awaits nothing before it has done so.
        """
        answers: _Answers = {}
        isolated, asked = self._threads.isolated(robots), tuple(self._fields.intersection(fields))
        if record is not None and isolated and asked:
            tasks = [
                asyncio.create_task(self._threads.call((name,), self._fill, answers, record, name, asked))
                for name in isolated
            ]
            try:
                await asyncio.wait(tasks, timeout=ANSWER_S)
            finally:
                for task in tasks:
                    task.cancel()
        self._answers = dict(answers)

    def _fill(self, answers: _Answers, record: TickRecord, robot: str, fields: Iterable[str]) -> None:
        for field in fields:
            with suppress(Exception):  # a model without an answer, or with a defect
                answers[robot, field] = self._value_of(record, robot, field)

    def value(self, record: TickRecord, robot: str, field: str) -> Any:
        """A field of a robot in a record."""
        if field in self._fields and self._threads.isolated((robot,)):
            return self._answers.get((robot, field))
        return self._value_of(record, robot, field)
