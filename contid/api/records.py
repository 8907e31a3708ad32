"""Structured results: record arrays in the shape of the rows that were given."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

#: A structured array with its fields as attributes.
Records: TypeAlias = "np.recarray[Any, np.dtype[np.record]]"


def records(shape: tuple[int, ...], **fields: Any) -> Records:
    """A record array of that shape from arrays with one entry per row."""
    layout = [(name, values.dtype, values.shape[1:]) for name, values in fields.items()]
    table = np.empty(int(np.prod(shape, dtype=int)), dtype=layout)
    for name, values in fields.items():
        table[name] = values
    return table.reshape(shape).view(np.recarray)


def renamed(table: np.ndarray[Any, Any], shape: tuple[int, ...], **fields: str) -> Records:
    """A table's own memory as a record array of that shape; each field with the name that it has there."""
    types = table.dtype.fields
    assert types is not None
    layout = np.dtype(
        {
            "names": list(fields),
            "formats": [types[own][0] for own in fields.values()],
            "offsets": [types[own][1] for own in fields.values()],
            "itemsize": table.dtype.itemsize,
        }
    )
    return table.view(layout).reshape(shape).view(np.recarray)
