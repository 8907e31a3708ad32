"""``contid calibrate``: parameters of models from measurements."""

from __future__ import annotations

from typing import Final

from contid.cli.support.table import TableGroup

#: Calibration -> (module that defines it as ``command``, one line for ``contid calibrate --help``).
CALIBRATIONS: Final[dict[str, tuple[str, str]]] = {
    "currents": (
        "contid_fit.commands.currents",
        "the usual current of a finger, from recordings without a contact",
    ),
    "curvature": (
        "contid_fit.commands.curvature",
        "a rack finger's curvature correction from photographed markers",
    ),
    "load": (
        "contid_fit.commands.load",
        "a pneumatic arm's error without load, so that it is not taken for a load",
    ),
    "modulus": (
        "contid_fit.commands.modulus",
        "a pneumatic section's modulus from elongation, its bending gain from angles",
    ),
    "tendon": (
        "contid_fit.commands.tendon",
        "a tendon robot's geometry, stiffness, friction and play from tips over pulls",
    ),
}

command = TableGroup(
    CALIBRATIONS,
    "Calibrations",
    "calibrate",
    help="Fit a model's parameters to measurements and write them back.",
)
