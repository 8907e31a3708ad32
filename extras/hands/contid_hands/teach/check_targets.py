"""Poses compared with the robots of a running daemon."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from contid.errors import BadInputError, Located, first_findings
from contid.remote.client.described_robot import columns_of
from contid.robot_file.findings import allowed_names
from contid_hands.teach.pose_file import PoseFile

#: A value beyond a limit by less than this is rounding [unit of the axis in files].
TOLERANCE = 1e-6


def check_targets(file: PoseFile, describe: Mapping[str, Any], names: set[str]) -> None:
    """Compare poses with the robots before anything moves; reach and rates are checked by the daemon.

    Args:
        file: file of the poses.
        describe: response of ``describe`` of the daemon.
        names: poses to check.

    Raises:
        BadInputError: unknown columns, and axes outside their limits, with their places.
    """
    limits: dict[str, tuple[float, float]] = {}
    owners: dict[str, list[str]] = {}
    for robot, columns in columns_of(describe).items():
        for column in describe["robots"][robot]["columns"]:
            owners.setdefault(column, []).append(robot)
            owners[f"{robot}.{column}"] = [robot]
        bounds = zip(columns.axes, columns.minimum, columns.maximum, strict=True)
        for column, low, high in bounds:
            plain = column.removeprefix(f"{robot}.")
            limits[plain] = limits[f"{robot}.{plain}"] = (low, high)
    findings = list(_findings(file, names, owners, limits))
    if findings:
        raise BadInputError(first_findings(findings))


def _findings(
    file: PoseFile,
    names: set[str],
    owners: Mapping[str, list[str]],
    limits: Mapping[str, tuple[float, float]],
) -> Iterator[Located]:
    for name in sorted(names):
        for column, value in file.pose(name).target.items():
            path = ("poses", name, "target", column)
            robots = owners.get(column, [])
            if not robots:
                message = f"unknown column {column!r}; {allowed_names(owners, column)}"
                yield file.document.at_key(path, message)
            elif len(robots) > 1:
                choices = " or ".join(f"{robot}.{column}" for robot in robots)
                yield file.document.at_key(path, f"{column!r} could be of several robots; write {choices}")
            elif column in limits:
                low, high = limits[column]
                if not low - TOLERANCE <= value <= high + TOLERANCE:
                    message = f"{column}: {value:g} is outside its limits, {low:g} to {high:g}"
                    yield file.document.at_value(path, message)
