"""Objects that extras and other distributions offer, found by the name of a group of entry points.

contid imports no extra: the metadata of a distribution names what it adds, and contid looks there.

| group | object |
|---|---|
| ``contid.commands`` | a table of commands, see `contid.cli.support.table` |
| ``contid.observers`` | options of `contid run`: `contid.cli.support.added_options.RunOption` |
| ``contid.exports`` | an option of `contid session export`: `contid_sessions.export_command.ExportOption` |
| ``contid.modes`` | options of `contid modes`, with ``options`` and ``write`` as an export has them |
| ``contid.checks`` | what `contid check` prints of the tip feedback of a robot: a function to a sentence |
| ``contid.goals`` | options of `contid move`: `contid.cli.support.added_options.GoalOption` |
| ``contid.workspaces`` | `contid.api.workspace.MeasureWorkspace`, of robots in the plane and in space |
| ``contid.emulators`` | by the name of a driver, a function like `contid.hal.Emulates.emulator` |
| ``contid.tools`` | by the name of a driver, an object with interfaces of `contid.hal.optional` for it |
| ``contid.chains`` | ``ropes``: a class of `contid.control.engine.stages.ChainGuards` of a loaded file |
| ``contid.solvers`` | by `RobotDescription.kinematics`, a class of models of a description |
| ``contid.clearance`` | ``bodies``: a class of `contid.control.engine.stages.BodyClearance` of a file |
| ``contid.library`` | names of ``contid`` and its client beside those of the core: ``Sim`` and others |
| ``contid.contacts`` | ``stage`` and ``squeeze`` of the extra `contact`, see its page |
| ``contid.recordings`` | ``compact``, ``data_frame`` and others of the extra `sessions`, see its page |
| ``contid.stretches`` | ``least``: of `contid run --stretch`, see `contid_paths.stretch.least_stretch` |
| ``contid.addresses`` | a function from a text ``NAME:...`` to a `contid.remote.client.wires.Address` |

Drivers (``contid.drivers``), bodies of simulated robots (``contid.bodies``), models
(``contid.models``) and stages of the tick (``contid.stages``) are found in the same way, by
`contid.hal.driver`, `contid.robot_file.model_plugins`, `contid.control.engine.stages`.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

from contid.errors import MissingPackageError

COMMANDS: Final = "contid.commands"
OBSERVERS: Final = "contid.observers"
CHECKS: Final = "contid.checks"
GOALS: Final = "contid.goals"
EXPORTS: Final = "contid.exports"
MODES: Final = "contid.modes"
WORKSPACES: Final = "contid.workspaces"
ADDRESSES: Final = "contid.addresses"
LIBRARY: Final = "contid.library"
RECORDINGS: Final = "contid.recordings"
STRETCHES: Final = "contid.stretches"
CONTACTS: Final = "contid.contacts"
CHAINS: Final = "contid.chains"
SOLVERS: Final = "contid.solvers"
CLEARANCE: Final = "contid.clearance"
EMULATORS: Final = "contid.emulators"
TOOLS: Final = "contid.tools"


def load_all(group: str) -> dict[str, Any]:
    """Every object of a group by its name, in the order of names, without packages that are not there."""
    points = {point.name: point for point in entry_points(group=group)}
    loaded = {name: _load(points[name]) for name in sorted(points)}
    return {name: found for name, found in loaded.items() if found is not None}


def load_one(group: str, name: str) -> Any | None:
    """The object of one name, None where no installed package offers it."""
    for point in entry_points(group=group, name=name):
        return _load(point)
    return None


@cache
def required(group: str, name: str, what: str, extra: str) -> Any:
    """The object of one name; looked up once, because that reads the metadata of every distribution.

    Args:
        group: of entry points.
        name: of the object.
        what: needs it, for the message.
        extra: that has it.

    Raises:
        MissingPackageError: no installed package offers it.
    """
    found = load_one(group, name)
    if found is None:
        package = (
            f"contid_{extra}, which is not installed; `pip install --force-reinstall contid` installs it"
        )
        raise MissingPackageError(f"{what} needs the package {package}")
    return found


def _load(point: EntryPoint) -> Any | None:
    """Import an object; None when its whole package was removed, as packagers of the core alone do."""
    try:
        return point.load()
    except ModuleNotFoundError as error:
        if error.name != point.module.partition(".")[0]:
            raise
        return None
