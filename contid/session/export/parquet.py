"""A session as a Parquet table: the columns of the joined CSV, with types; what is absent is null."""

from __future__ import annotations

from pathlib import Path

import contid
from contid.session.export.table import TickTable
from contid.session.read import Session
from contid.whole_file import replacing


def export_parquet(session: Session, path: Path) -> None:
    """Write all ticks; the metadata of the schema has the text of the robot file and the rate.

    Raises:
        ContidError: the file cannot be written.
    """
    import pyarrow as pa
    from pyarrow import parquet

    table = TickTable(session)
    kinds = [pa.int64() if whole else pa.float64() for whole in table.whole]
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
