"""Named poses of the robots that pages show: those of the pose file beside the robot file."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, Final

from contid.errors import BadInputError, ContidError
from contid.remote.client.described_robot import columns_of
from contid.remote.protocol.wire import Code, Fields, RemoteError
from contid.robot_file.findings import allowed_names
from contid_hands.teach.check_targets import check_targets
from contid_hands.teach.pose_file import PoseFile, read_pose_file
from contid_hands.teach.pose_store import default_pose_file, provenance, save_pose
from contid_hands.teach.present_pose import present_pose
from contid_panel.hub import Hub

log = logging.getLogger(__name__)

#: How often the file is looked at while a page is open.
PERIOD_S: Final = 0.5
#: Bytes of a pose file, and poses that a page shows.
MAX_BYTES: Final = 1 << 20
MAX_POSES: Final = 200

_ABSENT: Final = -1


@dataclass(frozen=True, slots=True)
class ShownPoses:
    """The poses that pages show.

    Attributes:
        targets: by name of the poses that suit the robots.
        message: for the pages.
    """

    targets: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    message: Fields = field(default_factory=dict)


class PanelPoses:
    """The pose file of the robots that the panel shows."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._shown = ShownPoses()
        #: What the read file depended on: the daemon's description, path, time of the change, size.
        self._version: tuple[Fields, Path, int, int] | None = None
        self._writing = asyncio.Lock()

    async def watch(self) -> None:
        """Read the file when it has changed, and send its poses to the pages."""
        reported = ""
        while True:
            try:
                await self._look()
            except Exception as error:  # such as of a folder that is gone for a moment
                if repr(error) != reported:
                    log.exception("panel: the poses cannot be read")
                reported = repr(error)
            await asyncio.sleep(PERIOD_S)

    def target(self, name: str) -> Mapping[str, float]:
        """The target of a pose as the pages show it.

        Raises:
            RemoteError: there is no such pose, or it does not suit the robots.
        """
        if name not in self._shown.targets:
            known = allowed_names(self._shown.targets, name) if self._shown.targets else "there is none"
            raise RemoteError(Code.BAD_TARGET, f"no pose {name[:40]!r} that suits the robots; {known}")
        return self._shown.targets[name]

    async def save(self, name: str, robots: Sequence[str] | None, replace: bool) -> Fields:
        """Save the measured pose of robots.

        Args:
            name: of the pose.
            robots: None for all.
            replace: a pose of that name may be replaced.

        Raises:
            RemoteError: a bad name, one that exists, an axis not read yet, or a file that cannot be written.
        """
        described = self._hub.described
        if described is None:
            raise RemoteError(Code.REFUSED, "no daemon: where the robots are is not known")
        target, messages = self._present(described, robots)
        path = Path(str(described["file"]))
        async with self._writing:
            try:
                await asyncio.to_thread(_save, path, name, target, replace)
            except ContidError as error:
                raise RemoteError(Code.REFUSED, str(error)) from None
            await self._look()
        return {"name": name, "target": target, "messages": messages}

    def _present(self, described: Fields, robots: Sequence[str] | None) -> tuple[dict[str, float], list[str]]:
        """The present target of robots, and messages about values outside their limits."""
        known = columns_of(described)
        measured: list[float] = []
        for name in robots or known:
            if name not in known:
                raise RemoteError(Code.UNKNOWN_ROBOT, f"no robot {name[:40]!r}; {allowed_names(known, name)}")
            values = self._hub.newest.get(name, {}).get("measured")
            if values is None or None in values:
                raise RemoteError(Code.REFUSED, f"{name}: not every axis has been read")
            measured += values
        return present_pose([known[name] for name in robots or known], measured)

    async def _look(self) -> None:
        described = self._hub.described
        if not self._hub.watched or described is None:
            return
        path = default_pose_file(Path(str(described["file"])))
        try:
            found = path.stat()
            changed_ns, size = found.st_mtime_ns, found.st_size
        except OSError:
            changed_ns, size = 0, _ABSENT
        version = (described, path, changed_ns, size)
        if version == self._version:
            return
        # In a thread: a stop must not wait for the file.
        self._shown = await asyncio.to_thread(_read, path, size, described)
        self._version = version
        self._hub.send("poses", lasting=True, **self._shown.message)


def _read(path: Path, size: int, described: Mapping[str, Any]) -> ShownPoses:
    """The poses of a file; one that cannot be read has a problem."""
    shown: Fields = {"file": path.name, "problem": "", "poses": []}
    if size == _ABSENT:
        return ShownPoses({}, shown)
    try:
        if size > MAX_BYTES:
            raise ContidError(f"{path}: {size} bytes; the panel reads {MAX_BYTES}")
        file = read_pose_file(path)
    except (ContidError, OSError) as error:
        return ShownPoses({}, {**shown, "problem": str(error)})
    targets = {}
    for name, pose in islice(file.contents.poses.items(), MAX_POSES):
        problem = _problem(file, name, described)
        if not problem:
            targets[name] = dict(pose.target)
        shown["poses"].append(
            {"name": name, "target": dict(pose.target), "saved": pose.saved, "problem": problem}
        )
    return ShownPoses(targets, shown)


def _problem(file: PoseFile, name: str, described: Mapping[str, Any]) -> str:
    """Why a pose does not suit the robots, "" if it does."""
    try:
        check_targets(file, described, {name})
    except BadInputError as error:
        return str(error.findings[0])
    return ""


def _save(robot_file: Path, name: str, target: Mapping[str, float], replace: bool) -> None:
    path = default_pose_file(robot_file)
    if not replace and path.exists() and name in read_pose_file(path).contents.poses:
        raise ContidError(f"{path.name} has a pose {name!r} already")
    save_pose(path, name, target, provenance(robot_file, "contid panel"), robot_file.name)
