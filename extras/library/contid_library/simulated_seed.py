"""A robot file whose simulated devices and trackers draw other noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from contid.robot_file.load import LoadedFile


def with_seed(loaded: LoadedFile, seed: int) -> LoadedFile:
    """The same file with one seed for its simulated buses, its trackers and the errors of its bodies."""
    buses = {
        name: replace(bus, options=_copied(bus.options, {"seed": seed})) if bus.driver == "sim" else bus
        for name, bus in loaded.buses.items()
    }
    robots = {name: _seeded(robot, seed) for name, robot in loaded.file.robots.items()}
    return replace(loaded, buses=buses, file=loaded.file.model_copy(update={"robots": robots}))


def _seeded(robot: Any, seed: int) -> Any:
    sim = getattr(robot, "sim", None)
    if sim is None:
        return robot
    parts = {key: getattr(sim, key, None) for key in ("tracker", "errors")}
    changes = {key: _copied(part, {"seed": seed}) for key, part in parts.items() if part is not None}
    return robot.model_copy(update={"sim": _copied(sim, changes)})


def _copied(model: Any, changes: Mapping[str, Any]) -> Any:
    """A model with those changes that it has keys for."""
    return model.model_copy(update={key: value for key, value in changes.items() if hasattr(model, key)})
