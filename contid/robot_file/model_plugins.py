"""Kinematic models of other distributions, found by entry points in the group ``contid.models``.

The name of an entry point is the value of the key ``model`` in a robot file; its object is a `ModelPlugin`.
It is imported only when a robot file names it.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final, Protocol, get_args

from contid.errors import ContidError
from contid.robot_file.robot import RobotDescription

ENTRY_POINT_GROUP: Final = "contid.models"


class ModelPlugin(Protocol):
    """Object of an entry point in the group ``contid.models``: keys and arithmetic; cheap to import."""

    #: Keys of the robot file; its ``model`` is ``Literal[NAME]`` with the name of the entry point.
    description: type[RobotDescription]

    def build(self, robot: Any) -> Any:
        """The model of a description, a `contid.kinematics.model.Model`."""


class ModelPluginError(ContidError):
    """An installed model cannot be used."""


def plugin_names() -> tuple[str, ...]:
    """Models of other distributions, sorted."""
    return tuple(sorted({point.name for point in entry_points(group=ENTRY_POINT_GROUP)}))


@cache
def load_plugin(name: str) -> ModelPlugin:
    """Import a model of another distribution by its name.

    Raises:
        ModelPluginError: it is not installed, cannot be imported, or is no model of that name.
    """
    points = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name == name]
    if not points:
        raise ModelPluginError(f"model {name!r} is not installed")
    point = points[0]
    try:
        plugin: ModelPlugin = point.load()
    except Exception as error:  # an import runs whatever its module does
        why = f"{type(error).__name__}: {error}"
        raise ModelPluginError(f"model {name!r} ({_origin(point)}) cannot be imported: {why}") from error
    _check(name, plugin, point)
    return plugin


def _check(name: str, plugin: ModelPlugin, point: EntryPoint) -> None:
    kind = getattr(plugin, "description", None)
    if not (isinstance(kind, type) and issubclass(kind, RobotDescription)):
        raise ModelPluginError(
            f"model {name!r} ({_origin(point)}): no description of a robot; see docs/models.md"
        )
    names = get_args(kind.model_fields["model"].annotation)
    if names != (name,):
        message = f"its description has model: Literal[{', '.join(map(repr, names))}], not {name!r}"
        raise ModelPluginError(f"model {name!r} ({_origin(point)}): {message}")


def _origin(point: EntryPoint) -> str:
    distribution = "" if point.dist is None else f"{point.dist.name}: "
    return f"{distribution}{point.value}"
