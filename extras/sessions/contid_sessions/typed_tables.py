"""A session as a typed table: Parquet with the columns of the joined CSV, or HDF5 with a group per channel.

In Parquet what is absent is null; HDF5 has the events as lines of JSON.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import contid
from contid.control.engine.events import RunEvent
from contid.control.engine.events.json_form import to_json
from contid.session.read import Session
from contid.whole_file import replacing
from contid_sessions.kept_error import KeptError
from contid_sessions.table import TickTable

#: Group of the times of the ticks.
TIME: Final = "time"
_CHUNK: Final = 4096


def export_parquet(session: Session, path: Path) -> None:
    """Write all ticks; the metadata of the schema has the text of the robot file and the rate.

    Raises:
        ContidError: the file cannot be written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    table = TickTable(session)
    kinds = [pa.int64() if is_integer else pa.float64() for is_integer in table.is_integer]
    about = {
        "contid": contid.__version__,
        "session": session.path.name,
        "rate_hz": repr(session.rate_hz),
        "robot_file": session.robot_text,
    }
    schema = pa.schema(list(zip(table.names, kinds, strict=True)), metadata=about)
    with replacing(path) as file, parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for block in table.blocks():
            columns = [
                pa.array(values, kind, from_pandas=True)  # NaN becomes null
                for values, kind in zip(table.series(block).values(), kinds, strict=True)
            ]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def export_hdf5(session: Session, path: Path) -> None:
    """Write all ticks and events; the attributes of the file have the text of the robot file and the rate.

    Raises:
        ContidError: the file cannot be written.
    """
    with replacing(path) as binary:
        kept = KeptError(binary)
        _write_hdf5(session, kept)
        if kept.error is not None:
            raise kept.error


def _write_hdf5(session: Session, kept: KeptError) -> None:
    """Write until the end or an error."""
    import h5py

    table = TickTable(session)
    with h5py.File(kept, "w") as file:
        file.attrs["contid"] = contid.__version__
        file.attrs["session"] = session.path.name
        file.attrs["rate_hz"] = session.rate_hz
        file.attrs["robot_file"] = session.robot_text
        columns = [
            _new(
                file, channel or TIME, name.removeprefix(f"{channel}."), "int64" if is_integer else "float64"
            )
            for name, is_integer, channel in zip(table.names, table.is_integer, table.channels, strict=True)
        ]
        events: list[tuple[float, str]] = []

        def keep_event(t_s: float, time_ns: int, event: RunEvent) -> None:
            events.append((t_s, json.dumps(to_json(event))))

        for block in table.blocks(keep_event):
            if kept.error is not None:
                return
            for dataset, values in zip(columns, table.series(block).values(), strict=True):
                dataset.resize((len(dataset) + len(values),))
                dataset[-len(values) :] = values
        file["event/t_s"] = [t_s for t_s, _ in events]
        file.create_dataset("event/json", data=[text for _, text in events], dtype=h5py.string_dtype())


def _new(file: Any, group: str, name: str, kind: str) -> Any:
    return file.create_dataset(
        f"{group}/{name}", (0,), kind, maxshape=(None,), chunks=(_CHUNK,), compression="gzip"
    )
