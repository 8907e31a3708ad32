"""Arrays given by a caller: shape, finite numbers, and messages that name the place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from contid.errors import ContidError
from contid.kinematics.array import Array

#: Largest number, as in trajectories: squares of larger ones overflow in the models.
MAX_NUMBER: Final = 1e10
#: What a rotation matrix may be off, in products of its columns.
ROTATION_ERROR: Final = 1e-6

#: Shape of the rows of a call: () for one row, (N,) for N, or more dimensions.
Shape: TypeAlias = tuple[int, ...]


class ArgumentError(ContidError, ValueError):
    """An argument of the library is wrong; the message has what was given and what is allowed."""


class GivenRows(NamedTuple):
    """Rows as an array ``(N, columns)``, and the shape of the rows as given."""

    values: Array
    shape: Shape


def as_rows(what: str, values: ArrayLike, columns: Sequence[str]) -> GivenRows:
    """Rows of numbers with these columns.

    Raises:
        ArgumentError: not numbers, another last dimension, or not finite.
    """
    array = _floats(what, values, describe_columns(columns))
    if array.ndim == 0 or array.shape[-1] != len(columns):
        raise ArgumentError(f"{what} has shape {array.shape}; {describe_columns(columns)}")
    rows = array.reshape(-1, len(columns))
    bad = ~(np.abs(rows) <= MAX_NUMBER)
    if bad.any():
        row, column = (int(index) for index in np.argwhere(bad)[0])
        value = rows[row, column]
        problem = f"above {MAX_NUMBER:g}" if np.isfinite(value) else "not a finite number"
        count = int(bad.any(axis=1).sum())
        more = f" ({count} such rows)" if count > 1 else ""
        raise ArgumentError(f"{what}: {columns[column]} in row {row} is {value}, {problem}{more}")
    return GivenRows(np.ascontiguousarray(rows), array.shape[:-1])


def as_rows_like(what: str, values: ArrayLike, columns: Sequence[str], shape: Shape) -> Array:
    """Rows beside others: one for all of them, or as many as there are.

    Raises:
        ArgumentError: as `as_rows`, or another number of rows.
    """
    rows, own = as_rows(what, values, columns)
    count = int(np.prod(shape, dtype=int))
    if own == shape:
        return rows
    if own == ():
        return np.broadcast_to(rows, (count, len(columns)))
    allowed = f"allowed: {(*shape, len(columns))}, or {(len(columns),)} for all rows"
    raise ArgumentError(f"{what} has shape {(*own, len(columns))}; {allowed}")


def as_directions(what: str, values: ArrayLike, columns: Sequence[str], shape: Shape) -> Array:
    """Rows normalised to unit vectors.

    Raises:
        ArgumentError: as `as_rows_like`, or a zero vector.
    """
    rows = as_rows_like(what, values, columns, shape)
    # Scaled first: squares of small numbers vanish.
    largest = np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    if (largest == 0.0).any():
        row = int(np.argmin(largest))
        raise ArgumentError(f"{what}: row {row} is the zero vector; a direction needs a length")
    scaled = rows / largest
    unit: Array = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    return unit


def as_rotations(what: str, values: ArrayLike, shape: Shape) -> Array:
    """Frames, shape ``(rows, 3, 3)``: one for all rows, or as many as there are.

    Raises:
        ArgumentError: another shape, not finite, or columns that are not orthonormal.
    """
    given = _floats(what, values, "expected: (3, 3) or (N, 3, 3)")
    if given.shape[-2:] != (3, 3) or given.shape[:-2] not in (shape, ()):
        raise ArgumentError(
            f"{what} has shape {given.shape}; allowed: {(*shape, 3, 3)}, or (3, 3) for all rows"
        )
    count = int(np.prod(shape, dtype=int))
    turns = np.broadcast_to(given.reshape(-1, 3, 3), (count, 3, 3))
    off = np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = ~(off <= ROTATION_ERROR)
    if bad.any():
        raise ArgumentError(f"{what}: row {int(np.argmax(bad))} is no rotation matrix: columns of length 1")
    return np.ascontiguousarray(turns)


def as_values(what: str, values: ArrayLike, shape: Shape) -> Array:
    """Numbers, one for each row.

    Raises:
        ArgumentError: not numbers, or another shape.
    """
    array = _floats(what, values, f"expected shape: {shape}")
    if array.shape != shape:
        raise ArgumentError(f"{what} has shape {array.shape}; expected {shape}, one per row")
    return array.reshape(-1)


def _floats(what: str, values: ArrayLike, shape: str) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ArgumentError(f"{what}: an array of numbers is needed, {shape} ({error})") from None


def describe_columns(columns: Sequence[str]) -> str:
    """The shape of rows with these columns."""
    size = len(columns)
    return f"expected: ({size},) or (N, {size}) with columns {', '.join(columns)}"
