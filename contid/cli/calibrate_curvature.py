"""``contid calibrate curvature``: the curvature correction of rack fingers."""

from __future__ import annotations

import json
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

if TYPE_CHECKING:
    from contid.calibrate.curvature import CurvatureFit


@click.command(name="curvature")
@click.argument("data", type=click.File("r", encoding="utf-8"))
@click.option("--for", "robot_file", help="Robot file (or the name of a shipped one) with the dimensions.")
@click.option(
    "--write",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Robot file to take the dimensions from and to write the fit into.",
)
@click.option("--robot", "robot_name", help="Which robot, where the file has several.")
@click.option("--mm-per-px", type=click.FloatRange(min=0, min_open=True), help="Size of a pixel: x_px,y_px.")
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), help="Write a figure (PNG, SVG).")
@click.option("--json", "as_json", is_flag=True, help="The fit as one JSON object.")
def command(
    data: TextIO,
    robot_file: str | None,
    write: Path | None,
    robot_name: str | None,
    mm_per_px: float | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Fit epsilon = a S + b to DATA, a CSV with one row per marker.

    Columns: posture (any name), the command (left_mm,right_mm or arc_length_mm,curvature_per_mm) and the
    marker (x_mm,y_mm, or x_px,y_px with --mm-per-px). A circle is fitted to the markers of every posture;
    its curvature over the commanded one gives epsilon (Morita et al., eq. 11).
    """
    from contid.calibrate.curvature import fit_curvature, read_postures
    from contid.calibrate.target_robot import find_robot
    from contid.description.rack_finger import RackFinger

    if (robot_file is None) == (write is None):
        raise click.UsageError("name the robot's file: --write FILE to change it, --for FILE to only read it")
    name, robot = find_robot(str(write or robot_file), robot_name, RackFinger, "rack finger")
    source = getattr(data, "name", "stdin").strip("<>")
    spacing_mm = robot.geometry.rack_spacing_mm
    fit = fit_curvature(read_postures(data, source, rack_spacing_mm=spacing_mm, mm_per_px=mm_per_px))
    click.echo(json.dumps(_numbers(fit)) if as_json else _words(fit))
    if plot is not None:
        from contid.calibrate.curvature_plot import plot_curvature

        plot_curvature(plot, fit)
    if write is not None:
        _write(write, name, fit, Path(source).name)


def _numbers(fit: CurvatureFit) -> dict[str, object]:
    return {
        "a_per_mm": fit.a_per_mm,
        "a_half_width_per_mm": fit.a_half_width_per_mm,
        "b": fit.b,
        "b_half_width": fit.b_half_width,
        "confidence": 0.95,
        "rms_epsilon": fit.rms_epsilon,
        "arc_length_mm": list(fit.arc_length_mm),
        "postures": [
            {
                "posture": posture.name,
                "arc_length_mm": posture.arc_length_mm,
                "commanded_per_mm": posture.commanded_per_mm,
                "fitted_per_mm": posture.circle.curvature,
                "epsilon": posture.epsilon,
                "markers": posture.markers,
                "rms_mm": posture.circle.rms,
            }
            for posture in fit.postures
        ],
    }


def _words(fit: CurvatureFit) -> str:
    worst = max(fit.postures, key=lambda posture: posture.circle.rms)
    return (
        f"{len(fit.postures)} postures, arc length {fit.arc_length_mm[0]:g} to {fit.arc_length_mm[1]:g} mm\n"
        f"  a = {fit.a_per_mm:.6g} +- {fit.a_half_width_per_mm:.2g} /mm (95 %)\n"
        f"  b = {fit.b:.6g} +- {fit.b_half_width:.2g} (95 %)\n"
        f"  residual of epsilon: {fit.rms_epsilon:.4g} rms; worst circle {worst.name!r}: "
        f"{worst.circle.rms:.3g} mm rms"
    )


def _write(path: Path, robot: str, fit: CurvatureFit, source: str) -> None:
    from contid.calibrate.target_robot import write_back
    from contid.description.edit import Change

    note = f"calibrated {date.today().isoformat()} from {source}"
    a_note = f"{note}, +- {fit.a_half_width_per_mm:.2g} (95 %)"
    b_note = f"{note}, +- {fit.b_half_width:.2g} (95 %)"
    write_back(
        path,
        robot,
        [
            Change("correction.a_per_mm", float(f"{fit.a_per_mm:.6g}"), a_note),
            Change("correction.b", float(f"{fit.b:.6g}"), b_note),
            Change("correction.arc_length_mm", [round(value, 4) for value in fit.arc_length_mm], note),
        ],
    )
    click.echo(f"written to {path}", err=True)
