"""The laboratory of the campaigns: hand, tri-rack and pneumatic arm in one robot file, on simulated buses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import yaml

from contid.robot_file.load import LoadedFile, find_robot_file, load_robot_file, parse_robot_file

MEMBERS: Final = ("hand", "trirack", "cbha")


def lab_text(rate_hz: float = 200.0, kind: str = "", members: Sequence[str] = MEMBERS) -> str:
    """The robot files of the members as one; every bus and robot gets its file's name in front.

    Args:
        rate_hz: of the laboratory.
        kind: ``.emulated`` for the members' files with emulated wires.
        members: their robot files.
    """
    lab: dict[str, Any] = {"contid": 1, "name": "lab", "rate_hz": rate_hz, "buses": {}, "robots": {}}
    for member in members:
        loaded = load_robot_file(find_robot_file(member + kind))
        raw = yaml.safe_load(loaded.text)
        for name, bus in raw["buses"].items():
            lab["buses"][f"{member}_{name}"] = bus
        for name, robot in raw["robots"].items():
            for axis in robot["axes"].values():
                axis["bus"] = f"{member}_{axis['bus']}"
            lab["robots"][f"{member}_{name}"] = robot
    return yaml.safe_dump(lab, sort_keys=False, default_flow_style=None)


def lab(rate_hz: float = 200.0) -> LoadedFile:
    """The laboratory, loaded; `contid.robot_file.load.with_mock` makes it simulated."""
    return parse_robot_file(lab_text(rate_hz), "lab.yaml")
