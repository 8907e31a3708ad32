"""What a robot file needs of extras: one that is not installed refuses the file before a device is opened."""

from __future__ import annotations

from typing import Any, Final

from contid.entry_points import CHAINS, CLEARANCE, CONTACTS, SOLVERS, required
from contid.robot_file.chain import Chain
from contid.robot_file.load import LoadedFile
from contid.robot_file.robot import RobotDescription

#: `RobotDescription.kinematics` -> the extra with its model, an entry point of the group ``contid.solvers``.
SOLVED_BY: Final[dict[str, str]] = {
    "tendon.driven": "tendons",
    "tendon.rod": "tendons",
    "tri_tube.ph": "ropes",
}


def require_extras(loaded: LoadedFile) -> None:
    """Look for the extras that solve and watch over the robots of a file, simulated or not.

    Raises:
        ContidError: one is not installed; the message has the key that needs it, and the remedy.
    """
    if loaded.file.clearance is not None:
        load_clearance(loaded)
    for name, robot in loaded.file.robots.items():
        if isinstance(robot, Chain):
            load_chains(loaded, name)
        elif robot.kinematics in SOLVED_BY:
            load_solver(robot, f"{loaded.path}: robots.{name}: its model")
        sense = getattr(robot, "sense", None)
        if getattr(sense, "contact", None) is not None:
            required(CONTACTS, "stage", f"{name}: its key `sense.contact`", "contact")
        if getattr(sense, "nm_per_a", None) is not None:
            load_squeezes(name)


def load_clearance(loaded: LoadedFile) -> Any:
    """What keeps the bodies of a file apart (`contid.control.engine.stages.BodyClearance`), by the file."""
    return required(CLEARANCE, "bodies", f"{loaded.path}: its key `clearance`", "clearance")


def load_chains(loaded: LoadedFile, robot: str) -> Any:
    """What keeps the arms of a chain together (`contid.control.engine.stages.ChainGuards`), by the file."""
    return required(CHAINS, "ropes", f"{loaded.path}: robots.{robot}: its model `chain`", "ropes")


def load_solver(robot: RobotDescription, what: str) -> Any:
    """The class of a model that an extra has, for a robot whose kinematics is in `SOLVED_BY`."""
    return required(SOLVERS, robot.kinematics, f"{what} `{robot.kinematics}`", SOLVED_BY[robot.kinematics])


def load_squeezes(robot: str) -> Any:
    """What closes a tip until a force (`contid.control.tick.squeezing.Squeezes`)."""
    return required(CONTACTS, "squeeze", f"{robot}: its key `sense.nm_per_a`", "contact")
