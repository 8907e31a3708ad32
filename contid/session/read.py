"""Reading a session, whole or cut off at any byte: its head, then ticks and events in their order.

Every order and answer that a tick saw comes before that tick (the recorder fetches events first), so a reader
that goes through once, forward, knows at each tick all that its replay needs.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from contid.control.record import RecordLayout, TickRecord
from contid.description.load import LoadedFile, parse_robot_file, with_mock
from contid.errors import BadInputError, ContidError
from contid.session import mcap_records as mcap
from contid.session.about import FORMAT, TRAJECTORY, unpacked
from contid.session.channels import CHANNELS, EVENT, TICK_CHANNELS
from contid.session.decode import Decoder
from contid.session.mcap_records import MESSAGE_INSIDE, DamagedRecordError, RecordStream
from contid.trajectory.timed import Trajectory

#: `Session.cut` of a file in the middle of which something is wrong: what follows is there, but not read.
DAMAGED: Final = "damaged inside"
#: Ticks between two words about how far it has come.
_OFTEN: Final = 1000
#: More than any run has.
_TICKS: Final = 1 << 53
#: What a message that does not hold what it should raises on its way into a record or an event.
_DAMAGE: Final = (
    *(ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError),
    *(struct.error, DamagedRecordError),
)


class SessionError(ContidError):
    """A file is no session, or one that this version cannot use."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One tick or one event.

    Attributes:
        time_ns: time of day since 1970.
        values: of the record, None for an event.
        event: its fields, None for a tick.
    """

    time_ns: int
    values: list[float] | None = None
    event: Mapping[str, Any] | None = None


class Session:
    """One file.

    Attributes:
        path: of the file.
        about: texts by group and name, as `contid.session.about` writes them.
        layout: of the records.
        device_units: ``rad`` or ``pa`` by ``ROBOT.AXIS``.
        rate_hz: of the ticks.
        clean: after `entries` came to the end: the file ends as it should.
        chunked: the same: it was compacted.
        cut: the same: what was found where it ends before its end, "" when it is clean.
    """

    def __init__(self, path: Path, progress: Callable[[int], None] = lambda ticks: None) -> None:
        """Read the head.

        Args:
            path: of the file.
            progress: called with the number of ticks now and then, while `entries` reads.

        Raises:
            SessionError: the file is no session, or its head is cut off.
        """
        self.path = path
        self._progress = progress
        self.about: dict[str, dict[str, str]] = {}
        self.clean = self.chunked = False
        self.cut = ""
        self._attachments: dict[str, bytes] = {}
        self._topics: dict[int, str] = {}
        if path.exists() and not path.is_file():
            raise SessionError(f"{path}: not a file that can be read twice, as a session is")
        try:
            with path.open("rb") as file:
                if (begin := file.read(len(mcap.MAGIC))) != mcap.MAGIC:
                    raise SessionError(f"{path}: {'not an MCAP file' if begin else 'empty'}")
                file.seek(0)
                begun = self._read_head(RecordStream(file))
        except OSError as error:
            raise SessionError(f"{path}: cannot read it: {error.strerror}") from error
        except DamagedRecordError as error:
            raise SessionError(f"{path}: its head is damaged: {error}") from error
        version = self.about.get("contid", {}).get("format")
        known = set(self._topics.values()) & {*CHANNELS}
        if version is None or not (begun or len(known) == len(CHANNELS)):
            words = "; `mcap filter` keeps its metadata with --include-metadata" if begun and known else ""
            raise SessionError(f"{path}: not a session of contid, or cut off before its first tick{words}")
        if version != FORMAT:
            raise SessionError(f"{path}: format {version}; this contid reads format {FORMAT}")
        try:
            self.layout = RecordLayout.from_json(self.about["layout"]["record"])
            self.device_units: dict[str, str] = json.loads(self.about["layout"]["device_units"])
            # Whatever follows needs these to fit each other.
            Decoder(self.layout, self.device_units)
            int(self.about["clock"]["wall_ns"])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SessionError(f"{path}: its head is damaged: {type(error).__name__}: {error}") from error
        self.rate_hz = self.layout.rate_hz

    def _read_head(self, stream: RecordStream) -> bool:
        """Everything before the first message; True when there is one."""
        for opcode, body in stream:
            if opcode == mcap.MESSAGE:
                return True
            self._keep(opcode, body)
        return False

    def _keep(self, opcode: int, body: bytes) -> None:
        """Take a record that is no message.

        Trajectories may come between messages; in files that other programs rewrote, channels as well.
        """
        if opcode not in (mcap.METADATA, mcap.ATTACHMENT, mcap.CHANNEL):
            return
        record = mcap.understood(opcode, body)
        if opcode == mcap.METADATA:
            self.about[record.name] = dict(record.metadata)
        elif opcode == mcap.ATTACHMENT:
            self._attachments[record.name] = record.data
        else:
            self._topics[record.id] = record.topic

    def option(self, name: str) -> str:
        """What the run was asked for; "" when it was not said."""
        return self.about.get("options", {}).get(name, "")

    @property
    def virtual(self) -> bool:
        """True for a run in virtual time."""
        return self.option("virtual") == "true"

    @property
    def robot_text(self) -> str:
        """The text of the robot file.

        Raises:
            SessionError: it holds none.
        """
        text = self.about.get("robot_file", {}).get("text")
        if text is None:
            raise SessionError(f"{self.path}: it holds no robot file")
        return text

    def robot_file(self, wired: bool = False) -> LoadedFile:
        """The robot file of the run, its buses simulated when they were so.

        Args:
            wired: its own buses, even when they were simulated.

        Raises:
            SessionError: today's contid does not take it any more.
        """
        text, name = self.robot_text, self.about["robot_file"].get("name", "robot_file")
        try:
            loaded = parse_robot_file(text, name)
        except BadInputError as error:
            words = "its robot file is refused today; export it with --yaml, mend it, give it with --robot"
            raise SessionError(f"{self.path}: {words}. In the recorded text:\n{error}") from error
        return with_mock(loaded) if self.option("mock") == "True" and not wired else loaded

    def trajectory(self, loaded: LoadedFile, played: int = 0) -> Trajectory | None:
        """A timed trajectory, bit for bit; None when there is none.

        Args:
            loaded: whose columns they are.
            played: 0 for the one the run began with; n for the n-th that came later, once `entries` is there.
        """
        name = f"{TRAJECTORY}-{played}" if played else TRAJECTORY
        about = self.about.get(name)
        if about is None:
            return None
        if f"{name}.npz" not in self._attachments:
            words = "`mcap filter` keeps it with --include-attachments, if its time is kept"
            raise SessionError(f"{self.path}: its {name}.npz is missing; {words}")
        if not about.keys() >= {"columns", "sha256", "interpolation"}:
            raise SessionError(f"{self.path}: its trajectory has no columns")
        return unpacked(self._attachments[f"{name}.npz"], about, loaded)

    def entries(self) -> Iterator[Entry]:
        """Ticks and events in their order; a tick that is not whole is left out."""
        decoder = Decoder(self.layout, self.device_units)
        topics, first, last = self._topics, TICK_CHANNELS[0], TICK_CHANNELS[-1]
        inside, head = MESSAGE_INSIDE, MESSAGE_INSIDE.size
        gathered: list[Any] | None = None
        ticks = 0
        with self.path.open("rb") as file:
            stream = RecordStream(file)
            for opcode, body in stream:
                try:
                    if opcode != mcap.MESSAGE:
                        self._keep(opcode, body)
                        continue
                    channel, _, time_ns, _ = inside.unpack_from(body)
                    topic = topics.get(channel)
                    if topic == EVENT:
                        yield Entry(time_ns, None, _event(body[head:]))
                        continue
                    if topic == first:
                        gathered = []
                    if gathered is None or topic is None:
                        continue
                    decoder.gather(gathered, topic, body[head:])
                    if topic != last:
                        continue
                    values = decoder.record(gathered)
                except _DAMAGE:
                    self.cut = DAMAGED
                    return
                yield Entry(time_ns, values)
                gathered = None
                ticks += 1
                if ticks % _OFTEN == 0:
                    self._progress(ticks)
            self.clean, self.chunked = stream.clean, stream.chunked
        if not self.clean:
            self.cut = "the last tick is not whole" if gathered is not None else "it has no end"
            self.cut = DAMAGED if stream.damaged else self.cut

    def ticks(self) -> Iterator[TickRecord]:
        """Records of the ticks."""
        for entry in self.entries():
            if entry.values is not None:
                yield self.layout.decode(tuple(entry.values))

    def events(self) -> Iterator[Mapping[str, Any]]:
        """Events alone."""
        for entry in self.entries():
            if entry.event is not None:
                yield entry.event


def _event(data: bytes) -> Mapping[str, Any]:
    """The fields of an event.

    Raises:
        ValueError: it has no kind, or a tick that is no number of one.
    """
    fields = json.loads(data)
    if not isinstance(fields, dict) or not isinstance(fields.get("event"), str):
        raise ValueError("an event has no kind")
    tick = fields.get("tick", 0)
    if not isinstance(tick, int) or isinstance(tick, bool) or not 0 <= tick < _TICKS:
        raise ValueError("an event has no tick")
    return fields
