"""The ticks of a session as one table in the units of robot files, like `contid session export --csv`.

Columns are the times of the export, then those of all channels with the channel in front
(``command.left.left_mm``); what is absent is NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Final, cast

import numpy as np

from contid.control.engine.tick_layout import SKIPPED, TICK
from contid.errors import MissingExtraError
from contid.kinematics.array import Array
from contid.session.export import TIMES, Column, columns
from contid.session.format.channels import TICK_CHANNELS
from contid.session.format.entries import Entry

if TYPE_CHECKING:
    import pandas as pd

    from contid.session.read import Session

#: Ticks that are converted at once; a tick of a hand has 150 numbers.
_BLOCK: Final = 4096


def joined_columns(session: Session) -> dict[str, Column]:
    """The columns of all channels by their names in the table, without the times."""
    return {
        f"{channel}.{column.name}": column
        for channel in TICK_CHANNELS
        for column in columns(session, channel)
    }


def row_values(session: Session) -> Iterator[dict[str, float]]:
    """Every tick as values by column."""
    table = joined_columns(session)
    for block in _blocks(session, list(table.values())):
        for row in block.tolist():
            yield dict(zip((*TIMES, *table), row, strict=True))


def data_frame(session: Session) -> pd.DataFrame:
    """The whole table; its index is ``t_s``.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise MissingExtraError("to_pandas", "pandas", "data") from None
    table = joined_columns(session)
    names = (*TIMES, *table)
    blocks = list(_blocks(session, list(table.values())))
    values = np.concatenate(blocks) if blocks else np.empty((0, len(names)))
    whole = {TIMES[0], *(name for name, column in table.items() if column.scale is None)}
    series = {
        name: values[:, place].astype(np.int64) if name in whole else values[:, place]
        for place, name in enumerate(names)
    }
    frame = pd.DataFrame(series).set_index("t_s")
    frame.attrs |= {"session": str(session.path), "rate_hz": session.rate_hz}
    return frame


def _blocks(session: Session, table: Sequence[Column]) -> Iterator[Array]:
    """Rows of times and columns, shape ``(ticks, len(TIMES) + len(table))``."""
    slots = [column.slot for column in table]
    ticks = (entry for entry in session.entries() if entry.values is not None)
    zero_ns: int | None = None
    while block := list(islice(ticks, _BLOCK)):
        if zero_ns is None:
            zero_ns = _zero_ns(block[0], session.rate_hz)
        values = np.array([entry.values for entry in block])
        out = np.empty((len(block), len(TIMES) + len(table)))
        out[:, 0] = values[:, TICK]
        out[:, 1] = np.array([entry.time_ns - zero_ns for entry in block]) / 1e9
        out[:, 2] = (values[:, TICK] - values[:, SKIPPED]) / session.rate_hz
        out[:, 3] = np.array([entry.time_ns // 1000 for entry in block]) / 1e6
        for place, (slot, column) in enumerate(zip(slots, table, strict=True), len(TIMES)):
            out[:, place] = values[:, slot]
            if column.scale is not None:
                # Products and quotients, which arrays take as well.
                out[:, place] = cast(Callable[[Array], Array], column.scale)(values[:, slot])
        yield out


def _zero_ns(first: Entry, rate_hz: float) -> int:
    """The time of day of tick 0 [ns]: where ``t_s`` begins."""
    assert first.values is not None
    return first.time_ns - round(first.values[TICK] / rate_hz * 1e9)
