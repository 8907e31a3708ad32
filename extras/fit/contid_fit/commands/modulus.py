"""``contid calibrate modulus``: the modulus polynomial and the bending gain of pneumatic sections.

Numbers of equations are those of Shi et al., as in `contid_fit.calibrate.modulus`.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

import click

from contid_fit.commands.calibration import Calibration, calibration

if TYPE_CHECKING:
    from contid.robot_file.edit import Change
    from contid_fit.calibrate.modulus import ModulusFit


@calibration("modulus")
def command(request: Calibration) -> None:
    """Fit moduli to DATA, a CSV of p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg[,section][,trial].

    Elongations (equal pressures) give the polynomial of the modulus (eq. 20 of Shi et al.), bending angles
    the bending gain. With --write the numbers go into the robot file, with their origin as a comment.
    """
    from contid.errors import ContidError
    from contid.kinematics.cosserat.model import build_section
    from contid.robot_file.cosserat import Cosserat
    from contid_fit.calibrate.elongation_data import read_readings
    from contid_fit.calibrate.modulus import fit

    name, robot = request.find(Cosserat, "pneumatic arm")
    sections = [build_section(each) for each in robot.geometry.sections]
    readings = read_readings(request.lines, request.source)  # one at least
    numbers = sorted({reading.section for reading in readings})
    if numbers[-1] > len(sections):
        raise ContidError(f"{request.source}: it has sections {numbers}; the robot has {len(sections)}")
    fits = [fit(sections[number - 1], number, readings) for number in numbers]
    for found in fits:
        click.echo(json.dumps(_finite(asdict(found))) if request.as_json else _text(found))
    request.write_back(name, _changes(fits, request.note))
    if request.plot is not None:
        from contid_fit.calibrate.modulus_plot import plot_fits

        plot_fits(request.plot, [(sections[found.section - 1], found) for found in fits], readings)


#: Of x in eq. 20, for the coefficients b1 to b5.
_POWERS: Final = (4, 3, 2, 1, 0)


def _finite(values: dict[str, object]) -> dict[str, object]:
    """JSON has no infinity; an open end is null."""
    return {key: None if value == math.inf else value for key, value in values.items()}


def _text(found: ModulusFit) -> str:
    grows = "everywhere" if found.grows_to_bar == math.inf else f"up to {found.grows_to_bar:.3f} bar"
    lines = [
        f"section {found.section}: {found.readings} elongations, {found.levels} pressures, "
        f"{found.trials} trials",
        "  E = "
        + " ".join(f"{b:+.4g} x^{power}" for power, b in zip(_POWERS, found.modulus_pa, strict=True))
        + "  [Pa, x in bar]",
        f"  RMSE: modulus {found.rmse_modulus_pa:.2f} Pa, elongation {found.rmse_elongation_mm:.3f} mm",
        f"  elongation grows with pressure {grows}; modulus_up_to_bar {found.up_to_bar:.3f} "
        f"(measured up to {found.measured_to_bar:.3f})",
    ]
    if found.bending_gain is not None:
        lines.append(
            f"  bending_gain {found.bending_gain:.4f} from {found.bends} angles, "
            f"RMSE {found.rmse_bend_deg:.2f} deg"
        )
    return "\n".join(lines)


def _changes(fits: list[ModulusFit], note: str) -> list[Change]:
    from contid.robot_file.edit import Change

    changes = []
    for found in fits:
        key = f"geometry.sections.{found.section - 1}"
        fitted = f"{note}, RMSE {found.rmse_elongation_mm:.3f} mm"
        changes.append(Change(f"{key}.modulus_pa", [round(b, 3) for b in found.modulus_pa], fitted))
        changes.append(Change(f"{key}.modulus_up_to_bar", round(found.up_to_bar, 4), note))
        if found.bending_gain is not None:
            bent = f"{note}, RMSE {found.rmse_bend_deg:.2f} deg"
            changes.append(Change(f"{key}.bending_gain", round(found.bending_gain, 5), bent))
    return changes
