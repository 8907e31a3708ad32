"""Differences of two robot files, key by key, and which of them exclude a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from contid.control.engine.wiring import record_layout
from contid.errors import ContidError
from contid.robot_file.findings import with_renamed_keys
from contid.robot_file.load import LoadedFile
from contid.session.read import Session


@dataclass(frozen=True, slots=True)
class Difference:
    """One key with another value.

    Attributes:
        key: dotted path, list entries by number.
        recorded: its recorded value as text; "" if absent.
        now: its present value, likewise.
    """

    key: str
    recorded: str
    now: str

    def __str__(self) -> str:
        """``key: recorded -> now``."""
        return f"{self.key}: {self.recorded or 'absent'} -> {self.now or 'absent'}"


def differences(recorded: str, now: str) -> list[Difference]:
    """Keys of two YAML texts that differ; comments and layout do not count."""
    then, today = (
        dict(_leaves(with_renamed_keys(yaml.safe_load(recorded)))),
        dict(_leaves(with_renamed_keys(yaml.safe_load(now)))),
    )
    keys = [*then, *(key for key in today if key not in then)]
    return [
        Difference(key, then.get(key, ""), today.get(key, ""))
        for key in keys
        if then.get(key, "") != today.get(key, "")
    ]


def _leaves(data: Any, path: str = "") -> Iterator[tuple[str, str]]:
    front = f"{path}." if path else ""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _leaves(value, f"{front}{key}")
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from _leaves(value, f"{front}{number}")
    else:
        yield path, repr(data)


def refuse_other_robots(session: Session, loaded: LoadedFile) -> None:
    """Refuse a robot file with other robots or axes than a recording.

    Raises:
        ContidError: naming both.
    """
    then = {(robot.name, robot.axes) for robot in session.layout.robots}
    now = {(robot.name, robot.axes) for robot in record_layout(loaded, session.rate_hz).robots}
    if then != now or len(loaded.driven) != len(session.layout.robots):
        raise ContidError(
            f"{loaded.path}: other robots or axes than recorded: recorded {_named(then)}; here {_named(now)}"
        )


def _named(robots: set[tuple[str, tuple[str, ...]]]) -> str:
    return "; ".join(f"{name} ({', '.join(axes)})" for name, axes in sorted(robots))


def refuse_another_robot(recorded: LoadedFile, now: LoadedFile) -> None:
    """Refuse to send recorded commands to another robot.

    Names, models, limits, rates and the axes (bus, id, direction, zero, pinion) must be equal. Ports of buses
    may differ, and geometry, which does not matter in actuator space.

    Raises:
        ContidError: naming every key that differs.
    """
    different = [
        each for each in differences(recorded.text, now.text) if _binding(each.key, set(recorded.file.robots))
    ]
    if different:
        lines = "\n".join(f"  {each}" for each in different)
        raise ContidError(f"{now.path}: not the recorded robot; no command is sent. Differences:\n{lines}")


def _binding(key: str, robots: set[str]) -> bool:
    if key == "name":
        return True
    top, _, rest = key.partition(".")
    if top != "robots":
        return False
    robot, _, part = rest.partition(".")
    if robot not in robots:
        return True
    return part.split(".")[0] in ("model", "limits", "rates", "extra_mm", "extra_bar", "extra_deg", "axes")
