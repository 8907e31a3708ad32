"""How large a recording becomes in an hour, from one that is made for it and removed."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.control.engine.cycle import OnEnd, Sink
from contid.control.engine.events import RunEvent
from contid.control.process.pipe import RunSetup
from contid.robot_file.load import LoadedFile
from contid.session.format import mcap_records as mcap
from contid.session.format.metadata import describe
from contid.session.write import SessionWriter
from contid_sessions.compact import compact

_HOUR_S: Final = 3600.0


@dataclass(frozen=True, slots=True)
class PredictedSize:
    """Bytes of a recording per hour: while it grows, and when it is complete and compressed."""

    growing: float
    complete: float

    def __str__(self) -> str:
        """For a person."""
        return (
            f"recording: about {self.growing / 1e9:.2g} GB per hour while it runs, "
            f"{self.complete / 1e9:.2g} GB when it is complete"
        )


class _Counted:
    """A sink that counts the ticks which it passes on."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self.ticks = 0

    def write(self, values: list[float]) -> None:
        self.ticks += 1
        self._sink.write(values)

    def event(self, event: RunEvent) -> None:
        self._sink.event(event)


def predicted_size(loaded: LoadedFile, rate_hz: float, run: Callable[[Sink], None]) -> PredictedSize:
    """The size of recordings of a file.

    Args:
        loaded: the robot file.
        rate_hz: of the tick.
        run: writes the ticks of a typical run, some hundreds of them.

    Raises:
        ContidError: the folder for temporary files cannot be written, or ``run`` raises it.
    """
    setup = RunSetup(loaded, rate_hz, Path(), None, OnEnd.HOLD, attended=True)
    with tempfile.TemporaryDirectory(prefix="contid-size-") as folder:
        path = Path(folder) / "size.mcap"
        writer = SessionWriter(path, describe(setup, {}, virtual=True))
        try:
            head = path.stat().st_size
            counted = _Counted(writer)
            run(counted)
            writer.flush()
            grown = path.stat().st_size - head
        finally:
            writer.close()
        empty = compact(path, path.with_name("empty.mcap"), max_entries=0).stat().st_size
        complete = compact(path).stat().st_size - empty
    ticks = max(counted.ticks, 1)
    frame = len(mcap.plain_chunk(b"", 0, 0))  # a running recorder writes every tick at once
    per_hour = rate_hz * _HOUR_S / ticks
    return PredictedSize(per_hour * (grown + frame * ticks), per_hour * max(complete, 0))
