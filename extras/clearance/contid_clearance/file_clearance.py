"""The clearance of a robot file for the control loop: what the entry point ``contid.clearance`` builds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from contid.control.engine.stages import EngineParts
from contid.control.tick.config import RobotConfig
from contid.errors import ContidError
from contid.robot_file.load import LoadedFile
from contid.targets import Actuation
from contid_clearance.guard import ClearanceGuard
from contid_clearance.lead import lead_around
from contid_clearance.preflight import ClearancePreflight
from contid_clearance.watch import ClearanceWatch


class FileClearance:
    """See `contid.control.engine.stages.BodyClearance`.

    Args:
        loaded: a file with ``clearance``.

    Raises:
        ContidError: bodies are too near with every robot at its rest pose.
    """

    def __init__(self, loaded: LoadedFile) -> None:
        self._guard = clearance_guard(loaded)

    def preflight(self, configs: Sequence[RobotConfig], seeds: Mapping[str, Actuation]) -> ClearancePreflight:
        """See `contid.control.tick.preflight.kept_apart.ChecksClearance`."""
        return ClearancePreflight(self._guard, configs, seeds)

    def stage(self, parts: EngineParts) -> ClearanceWatch:
        """The stage of the tick that keeps the bodies apart."""
        return ClearanceWatch(self._guard, parts)

    @staticmethod
    def lead(configs: Sequence[RobotConfig], loaded: LoadedFile) -> None:
        """Have redundant robots keep away from the obstacles of the file."""
        clearance = loaded.file.clearance
        if clearance is not None and clearance.obstacles:
            for config in configs:
                lead_around(config.model, config.frame, config.name, clearance)


def clearance_guard(loaded: LoadedFile) -> ClearanceGuard:
    """What a file keeps apart.

    Raises:
        ContidError: it states no clearance, or bodies are too near with every robot at its rest pose.
    """
    clearance = loaded.file.clearance
    if clearance is None:
        raise ContidError(f"{loaded.path}: it has no key clearance")
    guard = ClearanceGuard(loaded.file, clearance)
    nearest = guard.at_rest()
    if nearest and nearest[0].spare_m < 0.0:
        raise ContidError(f"{loaded.path}: at the rest pose, {nearest[0]}")
    return guard
