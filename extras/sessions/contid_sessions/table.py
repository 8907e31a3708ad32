"""The ticks of a session as one table in the units of robot files.

Columns are the times, those of all channels with the channel in front (``command.left.left_mm``), then the
measured axes and tips (``measured.left.x_mm``), and how far axes are from their commands
(``difference.left.left_mm``, measured less commanded); what is absent is NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from contid.control.engine.events import RunEvent
from contid.control.engine.tick_layout import SKIPPED, TICK
from contid.errors import MissingExtraError
from contid.kinematics.array import Array
from contid.session.format.channels import MEASURED, TICK_CHANNELS
from contid.session.format.entries import Entry
from contid_sessions.columns import TIMES, Column, RecordedTicks, channel_columns
from contid_sessions.measured import measured_block, measured_robots

if TYPE_CHECKING:
    import pandas as pd

#: Ticks that are converted at once; a tick of a hand has 150 numbers.
_BLOCK: Final = 4096
_COMMAND: Final = "command"
_DIFFERENCE: Final = "difference"


class TickTable:
    """All ticks of a session.

    Attributes:
        names: names of the columns: `TIMES`, those of the channels, those of the measured axes and tips.
        is_integer: for every column, True when its values are integers.
        channels: for every column, its channel, ``measured``, ``difference`` or "" for a time.
    """

    def __init__(self, session: RecordedTicks) -> None:
        self._session = session
        self._columns: list[Column] = []
        self._robots = measured_robots(session)
        names, channels = [*TIMES], [""] * len(TIMES)
        is_integer = [name == "tick" for name in TIMES]
        for channel in TICK_CHANNELS:
            for column in channel_columns(session, channel):
                self._columns.append(column)
                names.append(f"{channel}.{column.name}")
                is_integer.append(column.is_integer)
                channels.append(channel)
        for name in (name for robot in self._robots for name in robot.names):
            names.append(f"{MEASURED}.{name}")
            is_integer.append(False)
            channels.append(MEASURED)
        #: Columns of command and measurement of every axis, for their difference.
        self._pairs = [
            (names.index(command), place)
            for place, (channel, name) in enumerate(zip(channels, names, strict=True))
            if channel == MEASURED and (command := name.replace(MEASURED, _COMMAND, 1)) in names
        ]
        names += [names[place].replace(MEASURED, _DIFFERENCE, 1) for _, place in self._pairs]
        is_integer += [False] * len(self._pairs)
        channels += [_DIFFERENCE] * len(self._pairs)
        self.names, self.is_integer, self.channels = tuple(names), tuple(is_integer), tuple(channels)

    def blocks(self, event: Callable[[float, int, RunEvent], None] | None = None) -> Iterator[Array]:
        """Read the session once, in blocks of some thousand rows.

        Args:
            event: called with every event: its ``t_s``, its time of day since 1970 [ns], and itself.

        Yields:
            Rows of ticks in their order, in the units of the columns, shape ``(ticks, len(names))``.
        """
        zero_ns = _zero_time_ns(self._session)

        def ticks() -> Iterator[Entry]:
            for entry in self._session.entries():
                if entry.event is None:
                    yield entry
                elif event is not None:
                    event((entry.time_ns - zero_ns) / 1e9, entry.time_ns, entry.event)

        entries = ticks()
        while block := list(islice(entries, _BLOCK)):
            yield self._converted(block, zero_ns)

    def _converted(self, block: Sequence[Entry], zero_ns: int) -> Array:
        """The rows of some ticks; ``zero_ns`` is the time of day where ``t_s`` begins."""
        records = [entry.values for entry in block if entry.values is not None]
        values = np.array(records)
        out = np.empty((len(block), len(self.names)))
        times = {
            "tick": values[:, TICK],
            "t_s": np.array([entry.time_ns - zero_ns for entry in block]) / 1e9,
            "robot_s": (values[:, TICK] - values[:, SKIPPED]) / self._session.rate_hz,
            "unix_s": np.array([entry.time_ns // 1000 for entry in block]) / 1e6,
        }
        for place, name in enumerate(TIMES):
            out[:, place] = times[name]
        for place, column in enumerate(self._columns, len(TIMES)):
            recorded = values[:, column.slot]
            out[:, place] = recorded if column.quantity is None else column.quantity.from_si(recorded)
        measured, end = len(TIMES) + len(self._columns), len(self.names) - len(self._pairs)
        out[:, measured:end] = measured_block(self._robots, records)
        for place, (command, at) in enumerate(self._pairs, end):
            out[:, place] = out[:, at] - out[:, command]
        return out

    def series(self, block: Array) -> dict[str, Any]:
        """A block as arrays by column, integers where its values are."""
        return {
            name: block[:, place].astype(np.int64) if is_integer else block[:, place]
            for place, (name, is_integer) in enumerate(zip(self.names, self.is_integer, strict=True))
        }


def _zero_time_ns(session: RecordedTicks) -> int:
    """The time of day of tick 0 [ns], where ``t_s`` begins."""
    for entry in session.entries():
        if entry.values is not None:
            return entry.time_ns - round(entry.values[TICK] / session.rate_hz * 1e9)
    return int(session.metadata["clock"]["wall_ns"])


def row_values(session: RecordedTicks) -> Iterator[dict[str, float]]:
    """Every tick as values by column."""
    table = TickTable(session)
    for block in table.blocks():
        for row in block.tolist():
            yield dict(zip(table.names, row, strict=True))


def data_frame(session: RecordedTicks) -> pd.DataFrame:
    """The whole table; its index is ``t_s``.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("to_pandas", "pandas", "data") from None
    table = TickTable(session)
    blocks = list(table.blocks())
    values = np.concatenate(blocks) if blocks else np.empty((0, len(table.names)))
    frame = pd.DataFrame(table.series(values)).set_index("t_s")
    frame.attrs |= {"session": str(session.path), "rate_hz": session.rate_hz}
    return frame
