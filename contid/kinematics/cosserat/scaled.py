"""Rods whose moduli and pressure moments differ from a robot file by scales."""

from __future__ import annotations

from collections.abc import Sequence

from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.cosserat import Cosserat


def scaled_rod(
    robot: Cosserat, modulus: Sequence[float], moment: Sequence[float], elements: int | None = None
) -> CosseratModel:
    """The model of an arm with other moduli and moments.

    Args:
        robot: its description.
        modulus: per section, the part by which its modulus is greater.
        moment: per section, the part by which its pressure moment is greater.
        elements: integration steps per section; those of the file when left out.
    """
    sections = tuple(
        section.model_copy(
            update={
                "modulus_pa": tuple((1.0 + float(e)) * b for b in section.modulus_pa),
                "bending_gain": (1.0 + float(m)) * section.bending_gain,
            }
        )
        for section, e, m in zip(robot.geometry.sections, modulus, moment, strict=True)
    )
    solver = robot.solver if elements is None else robot.solver.model_copy(update={"elements": elements})
    geometry = robot.geometry.model_copy(update={"sections": sections})
    return CosseratModel(robot.model_copy(update={"geometry": geometry, "solver": solver}))
