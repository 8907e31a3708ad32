"""The tally of measured tips of a run in a daemon: isolated models are asked beside its event loop."""

from __future__ import annotations

import asyncio
from typing import Any

from contid.control.engine.measured_tip import MeasuredTips
from contid.control.engine.tick_layout import TickRecord
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.process.isolation.model_threads import ModelThreads
from contid.robot_file.load import LoadedFile


class MeasuredTipsBeside:
    """`MeasuredTips` of a run; a robot whose model answers slowly gets fewer samples, the others do not."""

    def __init__(self, loaded: LoadedFile, rate_hz: float, threads: ModelThreads) -> None:
        configs, layout = build_robot_configs(loaded, rate_hz), record_layout(loaded, rate_hz)
        names = [config.name for config in configs]
        isolated = threads.isolated(names)
        self._threads = threads
        self._at_once = MeasuredTips(configs, layout, [name for name in names if name not in isolated])
        self._beside = {name: MeasuredTips(configs, layout, (name,)) for name in isolated}
        self._asking: dict[str, asyncio.Task[None]] = {}

    def add(self, record: TickRecord | None) -> None:
        """Take a record; robots whose model has not answered for an earlier one leave it out."""
        self._at_once.add(record)
        for name, tips in self._beside.items():
            if name not in self._asking or self._asking[name].done():
                self._asking[name] = asyncio.create_task(self._threads.call((name,), tips.add, record))

    def complete(self, robots: dict[str, dict[str, Any]]) -> None:
        """See `MeasuredTips.complete`; models are not asked any more."""
        for task in self._asking.values():
            task.cancel()
        for tips in (self._at_once, *self._beside.values()):
            tips.complete(robots)
