"""``contid calibrate modulus``: the modulus polynomial and the bending gain of pneumatic sections."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

if TYPE_CHECKING:
    from contid.calibrate.modulus import ModulusFit


@click.command(name="modulus")
@click.argument("data", type=click.File("r", encoding="utf-8"))
@click.option("--for", "robot_file", help="Robot file (or the name of a shipped one) with the dimensions.")
@click.option(
    "--write",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Robot file to take the dimensions from and to write the fit into.",
)
@click.option("--robot", "robot_name", help="Which robot, where the file has several.")
@click.option(
    "--plot", type=click.Path(dir_okay=False, path_type=Path), help="Write a figure (PNG, SVG, PDF)."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per section.")
def command(
    data: TextIO,
    robot_file: str | None,
    write: Path | None,
    robot_name: str | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Fit moduli to DATA, a CSV of p1_bar,p2_bar,p3_bar,elongation_mm,bend_deg[,section][,trial].

    Elongations (equal pressures) give the polynomial of eq. 20, bending angles the bending gain. With --write
    the numbers go into the robot file, with their origin as a comment.
    """
    from contid.calibrate.elongation_data import read_readings
    from contid.calibrate.modulus import fit
    from contid.calibrate.target_robot import find_robot
    from contid.description.cosserat import Cosserat
    from contid.models.cosserat.model import build_section

    if (robot_file is None) == (write is None):
        raise click.UsageError("name the robot's file: --write FILE to change it, --for FILE to only read it")
    name, robot = find_robot(str(write or robot_file), robot_name, Cosserat, "pneumatic arm")
    sections = robot.geometry.sections
    readings = read_readings(data, getattr(data, "name", "stdin").strip("<>"))
    numbers = sorted({reading.section for reading in readings})
    if not numbers or numbers[-1] > len(sections):
        raise click.ClickException(f"the data has sections {numbers}; the robot has {len(sections)}")
    fits = [fit(build_section(sections[n - 1]), n, readings) for n in numbers]
    for found in fits:
        click.echo(json.dumps(_finite(asdict(found))) if as_json else _words(found))
    if plot is not None:
        from contid.calibrate.modulus_plot import plot_fits

        plot_fits(plot, [(build_section(sections[f.section - 1]), f) for f in fits], readings)
    if write is not None:
        _write(write, name, fits, Path(getattr(data, "name", "stdin")).name)


def _finite(values: dict[str, object]) -> dict[str, object]:
    """JSON has no infinity; an open end is null."""
    return {key: None if value == math.inf else value for key, value in values.items()}


def _words(found: ModulusFit) -> str:
    grows = "everywhere" if found.grows_to_bar == math.inf else f"up to {found.grows_to_bar:.3f} bar"
    lines = [
        f"section {found.section}: {found.readings} elongations, {found.levels} pressures, "
        f"{found.trials} trials",
        "  E = "
        + " ".join(f"{b:+.4g} x^{4 - i}" for i, b in enumerate(found.modulus_pa))
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


def _write(path: Path, robot: str, fits: list[ModulusFit], source: str) -> None:
    from contid.calibrate.target_robot import write_back
    from contid.description.edit import Change

    changes = []
    for found in fits:
        at = f"geometry.sections.{found.section - 1}"
        note = f"calibrated {date.today().isoformat()} from {source}"
        fitted = f"{note}, RMSE {found.rmse_elongation_mm:.3f} mm"
        changes.append(Change(f"{at}.modulus_pa", [round(b, 3) for b in found.modulus_pa], fitted))
        changes.append(Change(f"{at}.modulus_up_to_bar", round(found.up_to_bar, 4), note))
        if found.bending_gain is not None:
            bent = f"{note}, RMSE {found.rmse_bend_deg:.2f} deg"
            changes.append(Change(f"{at}.bending_gain", round(found.bending_gain, 5), bent))
    write_back(path, robot, changes)
    click.echo(f"written to {path}", err=True)
