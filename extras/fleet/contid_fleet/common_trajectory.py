"""One timed trajectory for several nodes: columns ``NODE/COLUMN`` over one ``t_s``, cut by node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from contid.errors import BadInputError, ContidError, Located
from contid.remote.client.move_arguments import columns_and_rows
from contid_fleet.keys import is_node_name

TIME: Final = "t_s"


@dataclass(frozen=True, slots=True)
class NodeRows:
    """The part of a node: columns as its daemon has them, ``t_s`` first, and rows of as many numbers."""

    columns: tuple[str, ...]
    rows: Sequence[Sequence[float]]


def read_common_trajectory(path: Path) -> Mapping[str, NodeRows]:
    """The rows by node of a CSV file.

    Raises:
        ContidError: it cannot be read, or a column has no node, with the place.
    """
    try:
        with path.open(encoding="utf-8") as file:
            columns, found = columns_and_rows(file)
            places = _places(str(path), columns)
            rows = list(found)
    except OSError as error:
        raise ContidError(f"{path}: cannot read it: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ContidError(f"{path}: not UTF-8 text") from error
    if not rows:
        raise ContidError(f"{path}: the trajectory has no rows")
    time_at = columns.index(TIME)
    return {
        node: NodeRows(
            (TIME, *(columns[at].partition("/")[2] for at in at_columns)),
            [[row[time_at], *(row[at] for at in at_columns)] for row in rows],
        )
        for node, at_columns in places.items()
    }


def _places(name: str, columns: Sequence[str]) -> dict[str, list[int]]:
    """Indices of the columns of each node.

    Raises:
        BadInputError: a column is neither ``t_s`` nor NODE/COLUMN, or there is no node or time.
    """
    places: dict[str, list[int]] = {}
    findings = []
    for at, column in enumerate(columns):
        node, slash, rest = column.partition("/")
        if column in columns[:at]:
            findings.append(f"column {column!r} is there twice")
        elif slash and is_node_name(node) and rest and rest != TIME:
            places.setdefault(node, []).append(at)
        elif column != TIME:
            findings.append(f"column {column!r}: t_s or NODE/COLUMN is expected, such as hand1/left.x_mm")
    if TIME not in columns:
        findings.append("no column t_s: a common start needs a timed trajectory")
    if not places and not findings:
        findings.append("no column of a node: NODE/COLUMN is expected, such as hand1/left.x_mm")
    if findings:
        raise BadInputError([Located(name, 1, 1, message) for message in findings])
    return places
