"""The clock of a session against that of the conductor of a fleet run, from the notes in the session.

conductor(t) = t - offset(t) + wall,    offset linear between two notes, constant before and after them
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import NoteWritten
from contid.errors import ContidError


@dataclass(frozen=True, slots=True)
class ClockNotes:
    """The notes of one conductor in a session, by time; there is one at least.

    Attributes:
        node: name of the session's node.
        conductor: the boot of the conductor's machine, which its clock counts from.
        notes: notes by time.
        wall_s: time of day less the clock of the conductor, from its first note.
    """

    node: str
    conductor: str
    notes: Sequence[NoteWritten]
    wall_s: float

    @property
    def bound_s(self) -> float:
        """The largest bound of an offset."""
        return max(note.bound_s for note in self.notes)

    @property
    def experiments(self) -> tuple[str, ...]:
        """Their names, in their order."""
        return tuple(dict.fromkeys(note.experiment for note in self.notes))

    def offset_s(self, at_s: float) -> float:
        """The offset of the session's clock at one of its times."""
        notes = self.notes
        after = bisect_right([note.at_s for note in notes], at_s)
        if after in (0, len(notes)):
            return notes[min(after, len(notes) - 1)].offset_s
        one, two = notes[after - 1], notes[after]
        share = (at_s - one.at_s) / (two.at_s - one.at_s)
        return one.offset_s + share * (two.offset_s - one.offset_s)

    def conductor_s(self, at_s: float) -> float:
        """A time of the session's clock, on that of the conductor."""
        return at_s - self.offset_s(at_s)


def clock_notes(name: str, events: Iterable[RunEvent]) -> dict[str, ClockNotes]:
    """The notes among the events of a session, by conductor.

    Raises:
        ContidError: it was recorded under several names of a node.
    """
    found: dict[str, list[NoteWritten]] = {}
    for event in events:
        if isinstance(event, NoteWritten):
            found.setdefault(event.conductor, []).append(event)
    out = {}
    for conductor, notes in found.items():
        nodes = sorted({note.node for note in notes})
        if len(nodes) > 1:
            raise ContidError(f"{name}: it has notes of several nodes: {', '.join(nodes)}")
        notes.sort(key=lambda note: note.at_s)
        kept = [note for number, note in enumerate(notes) if not number or note.at_s > notes[number - 1].at_s]
        out[conductor] = ClockNotes(nodes[0], conductor, kept, kept[0].wall_s)
    return out
