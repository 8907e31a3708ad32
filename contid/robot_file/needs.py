"""What a robot file needs of extras: one that is not installed refuses the file before a device is opened."""

from __future__ import annotations

from contid.entry_points import CHAINS, CLEARANCE, CONTACTS, required
from contid.robot_file.chain import Chain
from contid.robot_file.load import LoadedFile


def require_extras(loaded: LoadedFile) -> None:
    """Look for the extras that watch over the robots of a file, simulated or not.

    Raises:
        ContidError: one is not installed; the message has the key that needs it, and the remedy.
    """
    if loaded.file.clearance is not None:
        required(CLEARANCE, "bodies", f"{loaded.path}: its key `clearance`", "clearance")
    for name, robot in loaded.file.robots.items():
        if isinstance(robot, Chain):
            required(CHAINS, "ropes", f"{loaded.path}: robots.{name}: its model `chain`", "ropes")
        sense = getattr(robot, "sense", None)
        if getattr(sense, "contact", None) is not None:
            required(CONTACTS, "stage", f"{name}: its key `sense.contact`", "contact")
        if getattr(sense, "nm_per_a", None) is not None:
            required(CONTACTS, "squeeze", f"{name}: its key `sense.nm_per_a`", "contact")
