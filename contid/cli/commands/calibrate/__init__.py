"""``contid calibrate``: parameters of models from measurements."""

from __future__ import annotations

from typing import Final

from contid.cli.support.table import TableGroup

#: Calibration -> (module that defines it as ``command``, one line for ``contid calibrate --help``).
CALIBRATIONS: Final[dict[str, tuple[str, str]]] = {
    "currents": (
        "contid.cli.commands.calibrate.currents",
        "the usual current of a finger, from recordings without a contact",
    ),
    "curvature": (
        "contid.cli.commands.calibrate.curvature",
        "a rack finger's curvature correction from photographed markers",
    ),
    "load": (
        "contid.cli.commands.calibrate.load",
        "a pneumatic arm's error without load, so that it is not taken for a load",
    ),
    "modulus": (
        "contid.cli.commands.calibrate.modulus",
        "a pneumatic section's modulus from elongation, its bending gain from angles",
    ),
    "tendon": (
        "contid.cli.commands.calibrate.tendon",
        "a tendon robot's geometry, stiffness, friction and play from tips over pulls",
    ),
}

command = TableGroup(
    CALIBRATIONS,
    "Calibrations",
    "calibrate",
    help="Fit a model's parameters to measurements and write them back.",
)
