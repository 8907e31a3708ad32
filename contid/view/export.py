"""A recorded run as a picture: the same drawing, from records that are all there already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from contid.control.engine.tick_layout import RecordLayout
from contid.robot_file.load import LoadedFile
from contid.view.frames import Decimator, Frame
from contid.view.rerun_session import RerunSession
from contid.view.stage import build_stage
from contid.view.view_target import Kind, ViewTarget

#: Ticks that are written together.
BATCH: Final = 1024
#: Values of one record, or one event.
Entry = tuple[Sequence[float] | None, Mapping[str, Any] | None]


def draw(
    entries: Iterable[Entry],
    loaded: LoadedFile,
    layout: RecordLayout,
    where: ViewTarget,
    shown: Callable[[RerunSession], None] = lambda host: None,
) -> None:
    """Draw a whole run.

    Args:
        entries: ticks and events in their order.
        loaded: the robot file of the run.
        layout: of the records.
        where: the picture goes.
        shown: called when all is drawn, before a served page ends.

    Raises:
        ViewError: it cannot be shown there.
    """
    stage = build_stage(loaded, layout.rate_hz)
    decimator = Decimator(layout, curves=True)
    with RerunSession(where, loaded.file.name, stage, layout.rate_hz, live=False) as host:
        frames: list[Frame] = []
        for values, event in entries:
            if event is not None:
                host.picture.event(event)
            elif values is not None and (frame := decimator.add(values)) is not None:
                frames.append(frame)
                if len(frames) >= BATCH:
                    host.picture.write(frames)
                    frames.clear()
        if (last := decimator.rest()) is not None:
            frames.append(last)
        host.picture.write(frames)
        shown(host)


def export_rrd(
    entries: Iterable[Entry],
    loaded: LoadedFile,
    layout: RecordLayout,
    path: Path,
) -> None:
    """Write a run as a file for the viewer; replaces a file that is there."""
    draw(entries, loaded, layout, ViewTarget(Kind.FILE, path))
