"""Where poses of a robot file are kept, and saving one: atomically, comments and order of the file stay."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from io import StringIO
from pathlib import Path
from typing import Any, Final

from contid import __version__
from contid.errors import ContidError
from contid.robot_file.load import configs_folder
from contid.whole_file import replacing
from contid_hands.teach.pose_file import NAME_PATTERN, parse_pose_file, read_pose_file

_HEADER: Final = "# Named poses and sequences for `contid move --pose NAME` and `contid play FILE`.\n"
#: Decimals of saved values: a nanometre, 1 Pa.
DECIMALS: Final = 6


def default_pose_file(robot_file: Path) -> Path:
    """The pose file of a robot file: ``NAME.poses.yaml`` in its folder, or an existing ``poses.yaml``.

    Of a file that ships with contid in the present folder: the package is not written into.
    """
    folder = robot_file.parent
    if folder.resolve() == configs_folder().resolve():
        folder = Path()
    own, common = folder / f"{robot_file.stem}.poses.yaml", folder / "poses.yaml"
    return common if common.exists() and not own.exists() else own


def provenance(robot_file: Path, how: str) -> str:
    """When, by which version, how and for which robot file something was saved."""
    return (
        f"{datetime.now().astimezone():%Y-%m-%d %H:%M:%S%z}, contid {__version__}, {how}, {robot_file.name}"
    )


def save_pose(path: Path, name: str, target: Mapping[str, float], saved: str, robot_file: str) -> bool:
    """Save a pose into a file, which is made when it does not exist.

    Args:
        path: path of the pose file.
        name: name of the pose; one of that name is replaced.
        target: columns of a trajectory with their values.
        saved: see `provenance`.
        robot_file: its name, written into a new file.

    Returns:
        True when it replaced a pose.

    Raises:
        BadInputError: the file is no pose file.
        ContidError: a bad name, or the file cannot be written.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap

    if not re.fullmatch(NAME_PATTERN, name):
        message = f"{name[:40]!r} is no name of a pose; allowed: up to 64 letters, digits, _, - and ."
        raise ContidError(message)
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096
    yaml.indent(mapping=2, sequence=4, offset=2)
    document: Any
    if path.exists():
        read_pose_file(path)
        document = yaml.load(path.read_text(encoding="utf-8"))
    else:
        document = yaml.load(f"{_HEADER}contid_poses: 1\n")
        document["robot_file"] = robot_file
    if document.get("poses") is None:
        document["poses"] = CommentedMap()
    replaced = name in document["poses"]
    values = CommentedMap({column: round(value, DECIMALS) for column, value in target.items()})
    values.fa.set_flow_style()
    document["poses"][name] = CommentedMap({"target": values, "saved": saved})
    out = StringIO()
    yaml.dump(document, out)
    parse_pose_file(out.getvalue(), path)  # what is written can be read
    with replacing(path) as file:
        file.write(out.getvalue().encode())
    return replaced
