"""Tables in Parquet, Arrow, NumPy, MATLAB and HDF5 files, read where the library of each is installed."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from contid.errors import BadInputError, ContidError, Located, require_extra
from contid_adapt.meaning.units import unit_of_name
from contid_adapt.reading.cells import EXACT
from contid_adapt.reading.objects import column_of, flat
from contid_adapt.reading.source import Source
from contid_adapt.reading.table import Table, TableColumn

#: Structures inside structures that are looked into.
_MAX_DEPTH: Final = 4
#: Kinds of arrays that are columns: numbers, switches, dates and times.
_NUMBERS: Final = "fiubmM"


def read_binary(source: Source) -> Table:
    """The table of a file that is no text.

    Raises:
        MissingExtraError: the library that reads it is not installed.
        BadInputError: damaged, or without a table.
    """
    try:
        columns = list(_columns(source))
    except ContidError:
        raise
    except Exception as error:  # Libraries raise what they like on damaged files.
        message = f"a damaged {source.kind} file: {str(error)[:120]}"
        raise BadInputError([Located(source.name, 1, 1, message)]) from error
    sizes = [len(each.values) for each in columns]
    if not sizes:
        raise BadInputError([Located(source.name, 1, 1, f"no table in this {source.kind} file")])
    rows = max({*sizes} - {1} or {1}, key=sizes.count)
    others = dict.fromkeys(
        each.name.partition("[")[0] for each in columns if len(each.values) not in (1, rows)
    )
    columns = [each for each in columns if len(each.values) == rows]
    ones = np.ones(rows, np.int64)
    notes = [f"{source.kind} file with {rows} rows"]
    if others:
        notes.append(
            f"of other lengths and left out: {', '.join([*others][:12])}{', ..' * (len(others) > 12)}"
        )
    return Table(source.name, tuple(columns), np.arange(1, rows + 1), ones, notes=notes)


def _columns(source: Source) -> Iterator[TableColumn]:
    data = io.BytesIO(source.data)
    if source.kind == "npy":
        yield from _of_array("c", np.load(data, allow_pickle=False), 0)
    elif source.kind == "zip":
        names = zipfile.ZipFile(data).namelist()
        if any(name.startswith("xl/") for name in names):
            yield from _of_sheet(source)
        elif all(name.endswith(".npy") for name in names):
            with np.load(data, allow_pickle=False) as archive:
                yield from _of_arrays(dict(archive))
        else:
            message = "an archive: unpack it and give the table inside"
            raise BadInputError([Located(source.name, 1, 1, message)])
    elif source.kind == "parquet":
        require_extra("reading Parquet", "pyarrow")
        import pyarrow.parquet

        yield from _of_arrow(pyarrow.parquet.read_table(data))
    elif source.kind == "arrow":
        require_extra("reading Arrow and Feather", "pyarrow")
        import pyarrow.feather

        yield from _of_arrow(pyarrow.feather.read_table(data))
    elif source.kind == "mat":
        require_extra("reading MATLAB files", "scipy")
        import scipy.io

        found = scipy.io.loadmat(data, squeeze_me=True, struct_as_record=False)
        own = {name: each for name, each in found.items() if not name.startswith("__")}
        yield from _of_arrays(dict(_of_structs(own)))
    else:
        require_extra("reading HDF5 and MATLAB 7.3 files", "h5py")
        import h5py

        arrays: dict[str, Any] = {}
        with h5py.File(data, "r") as file:

            def keep(name: str, each: Any) -> None:
                if isinstance(each, h5py.Dataset) and (each.dtype.names or each.dtype.kind in _NUMBERS):
                    arrays[name.replace("/", ".")] = np.asarray(each)

            file.visititems(keep)
        yield from _of_arrays(arrays)


def _of_structs(given: dict[str, Any], before: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """The arrays of MATLAB structures: ``walk.data``."""
    for name, each in given.items():
        fields = getattr(each, "_fieldnames", None)
        if fields is None:
            yield before + name, each
        elif depth < _MAX_DEPTH:
            inner = {field: getattr(each, field) for field in fields}
            yield from _of_structs(inner, f"{before}{name}.", depth + 1)


def _of_arrow(table: Any) -> Iterator[TableColumn]:
    """The columns of a table of Arrow; lists and structures in cells are several columns."""
    import pyarrow

    place = 0
    for name, column in zip(table.column_names, table.columns, strict=True):
        if pyarrow.types.is_timestamp(column.type) or pyarrow.types.is_duration(column.type):
            column = column.cast(
                pyarrow.duration("ns") if "duration" in str(column.type) else "timestamp[ns]"
            )
        if column.null_count == 0 and not pyarrow.types.is_nested(column.type):
            array = column.to_numpy()
            if array.dtype.kind in _NUMBERS:
                place += 1
                yield _column(name, place, array)
                continue
        rows = [dict(flat(each, name)) for each in column.to_pylist()]
        for key in rows[0] if rows else ():
            place += 1
            yield column_of(key, place, [row.get(key) for row in rows])


def _of_arrays(arrays: dict[str, Any]) -> Iterator[TableColumn]:
    place = 0
    for name, each in arrays.items():
        array = np.asarray(each)
        if (array.dtype.names or array.dtype.kind in _NUMBERS) and array.ndim in (1, 2) and array.size:
            for column in _of_array(name, array, place):
                place = column.position
                yield column


def _of_array(name: str, array: Any, place: int) -> Iterator[TableColumn]:
    """The columns of an array, or of the fields of one of records."""
    if array.dtype.names:
        before = "" if name == "c" else f"{name}."
        for field in array.dtype.names:
            own = array[field].reshape(len(array), -1) if array.ndim == 1 else array[field].reshape(-1, 1)
            if own.dtype.kind in _NUMBERS:
                for column in _of_array(f"{before}{field}", own, place):
                    place = column.position
                    yield column
        return
    if array.ndim == 2 and array.shape[0] < array.shape[1] and array.shape[0] <= 12:
        array = array.T
    table = array.reshape(len(array), -1)
    for at in range(table.shape[1]):
        alone = name if table.shape[1] == 1 else (f"{name}{at + 1}" if name == "c" else f"{name}[{at}]")
        yield _column(alone, place + at + 1, table[:, at])


def _column(name: str, position: int, values: Any) -> TableColumn:
    """A column of numbers, of switches, or of dates and times, which become nanoseconds since 1970."""
    if values.dtype.kind in "mM":
        unit = "timedelta64[ns]" if values.dtype.kind == "m" else "datetime64[ns]"
        return TableColumn(name, position, values.astype(unit).astype(np.int64), "ns")
    exact = values.dtype.kind in "iu" and np.abs(values).max(initial=0) > EXACT
    return TableColumn(name, position, values.astype(np.int64 if exact else float), unit_of_name(name))


def _of_sheet(source: Source) -> Iterator[TableColumn]:
    from importlib.util import find_spec

    if find_spec("openpyxl") is None:
        raise ContidError(
            f"{source.name}: Excel files need openpyxl: pip install openpyxl, or save the sheet as CSV"
        )
    from importlib import import_module

    book = import_module("openpyxl").load_workbook(io.BytesIO(source.data), read_only=True, data_only=True)
    rows = [["" if cell is None else str(cell) for cell in row] for row in book.active.values]
    from contid_adapt.reading.text_table import read_text

    yield from read_text(["\t".join(row) for row in rows], source.name).columns
