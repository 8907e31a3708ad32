"""``contid fleet replay``: every session of a folder through today's code, and the skew of common starts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from contid.control.engine.events.robots import OrderGiven
from contid.control.engine.events.run import NoteWritten
from contid.errors import ContidError
from contid.session.read import Session
from contid_sessions.clock_notes import clock_notes
from contid_sessions.replay.compare import Divergence
from contid_sessions.replay.replay import Replayed, replay


@dataclass(frozen=True, slots=True)
class CommonStart:
    """The begin of one experiment, by node, on the conductor's clock [s], after the time ordered.

    Attributes:
        late_s: lateness by node.
        bound_s: largest error of the skew.
    """

    late_s: Mapping[str, float]
    bound_s: float

    @property
    def skew_s(self) -> float:
        """Between the first and the last."""
        return max(self.late_s.values()) - min(self.late_s.values())


@dataclass(frozen=True, slots=True)
class FleetReplay:
    """Replays by file, and common starts by experiment."""

    replayed: Mapping[Path, Replayed]
    starts: Mapping[str, CommonStart]

    @property
    def same(self) -> bool:
        """Every tick of every session was compared, and every command was equal."""
        return all(each.divergence is None and not each.stopped for each in self.replayed.values())


def replay_folder(folder: Path) -> FleetReplay:
    """Replay every session of a folder.

    Raises:
        ContidError: there is none, or one cannot be read.
    """
    paths = sorted(folder.glob("*.mcap")) if folder.is_dir() else []
    if not paths:
        raise ContidError(f"{folder}: no session (*.mcap) is there")
    replayed = {}
    begun: dict[str, dict[str, tuple[float, float]]] = defaultdict(dict)
    for path in paths:
        session = Session(path)
        replayed[path] = replay(session, session.robot_file())
        for note, late_s in _starts(Session(path)):
            begun[note.experiment][note.node] = late_s, note.bound_s
    starts = {}
    for experiment, nodes in begun.items():
        if len(nodes) > 1:
            bounds = sorted(bound_s for _, bound_s in nodes.values())
            late = {node: late_s for node, (late_s, _) in nodes.items()}
            starts[experiment] = CommonStart(late, sum(bounds[-2:]))
    return FleetReplay(replayed, starts)


def _starts(session: Session) -> Iterator[tuple[NoteWritten, float]]:
    """How late trajectories began that were ordered for a time [s], each with the note of its experiment."""
    events = list(session.events())
    clocks = clock_notes(str(session.path), events)
    note: NoteWritten | None = None
    for event in events:
        if isinstance(event, NoteWritten):
            note = event
        elif isinstance(event, OrderGiven) and event.order.get("order") == "go" and note is not None:
            began_s, at_s = float(event.order["began_s"]), float(event.order["at_s"])
            # The time ordered is one for all on the conductor's clock, with the offset of that moment.
            yield note, clocks[note.conductor].conductor_s(began_s) - (at_s - note.offset_s)


def divergence_text(divergence: Divergence) -> str:
    """The first value that differs, in a line."""
    values = f"{divergence.recorded:g} recorded, {divergence.replayed:g} replayed {divergence.unit}"
    return f"tick {divergence.tick}: {divergence.where} {divergence.what}: {values}"
