"""Draws a recorded run as a whole; its curves have every tick, its shapes some (`Decimator`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from typing import Final

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import RecordLayout
from contid.robot_file.load import LoadedFile
from contid_view.frames import Decimator
from contid_view.rerun.session import RerunSession
from contid_view.view_target import ViewTarget

#: Ticks that are written together.
BATCH: Final = 1024
#: Values of one record, or one event.
Entry = tuple[Sequence[float] | None, RunEvent | None]


def draw(
    entries: Iterable[Entry],
    loaded: LoadedFile,
    layout: RecordLayout,
    target: ViewTarget,
    on_drawn: Callable[[RerunSession], None] = lambda session: None,
) -> None:
    """Draw a whole run; a drawing that exists at the target is replaced.

    Args:
        entries: ticks and events in their order.
        loaded: the robot file of the run.
        layout: layout of the records.
        target: where to draw.
        on_drawn: called when everything is drawn, before a served page ends.

    Raises:
        ViewError: it cannot be drawn there.
    """
    with closing(RerunSession(target, loaded, layout.rate_hz, live=False)) as session:
        decimator = Decimator(layout, session.writer.write, BATCH, curves=True)
        for values, event in entries:
            if event is not None:
                session.writer.event(event)
            elif values is not None:
                decimator.add(values)
        decimator.finish()
        on_drawn(session)
