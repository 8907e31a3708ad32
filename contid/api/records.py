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
