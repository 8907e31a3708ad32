"""The packages of the extras ``contid[fleet]`` and ``contid[ros]``."""

from __future__ import annotations

from importlib.util import find_spec

from contid.errors import MissingExtraError


def require_extra() -> None:
    """Refuse to go on without Zenoh.

    Raises:
        MissingExtraError: with the remedy.
    """
    if find_spec("zenoh") is None:
        raise MissingExtraError("the fleet", "eclipse-zenoh", "fleet")


def require_ros() -> None:
    """Refuse to go on without the types of ROS 2.

    Raises:
        MissingExtraError: with the remedy.
    """
    if find_spec("rosbags") is None:
        raise MissingExtraError("messages of ROS 2", "rosbags", "ros")
