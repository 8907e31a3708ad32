"""``contid calibrate curvature``: the curvature correction of rack fingers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import POSITIVE
from contid_fit.commands.calibration import Calibration, calibration

if TYPE_CHECKING:
    from contid.robot_file.edit import Change
    from contid_fit.calibrate.curvature import CurvatureFit


@calibration("curvature")
@click.option("--mm-per-px", type=POSITIVE, help="Size of a pixel: x_px,y_px.")
def command(request: Calibration, mm_per_px: float | None) -> None:
    """Fit epsilon = a S + b to DATA, a CSV with one row per marker.

    Columns: posture (any name), the command (left_mm,right_mm or arc_length_mm,curvature_per_mm) and the
    marker (x_mm,y_mm, or x_px,y_px with --mm-per-px). A circle is fitted to the markers of every posture;
    its curvature over the commanded one gives epsilon (Morita et al., eq. 11).
    """
    from contid.robot_file.rack_finger import RackFinger
    from contid_fit.calibrate.curvature import fit_curvature, read_postures

    name, robot = request.find(RackFinger, "rack finger")
    spacing_mm = robot.geometry.rack_spacing_mm
    postures = read_postures(request.lines, request.source, rack_spacing_mm=spacing_mm, mm_per_px=mm_per_px)
    fit = fit_curvature(postures)
    click.echo(json.dumps(_numbers(fit)) if request.as_json else _text(fit))
    request.write_back(name, _changes(fit, request.note))
    if request.plot is not None:
        from contid_fit.calibrate.curvature_plot import plot_curvature

        plot_curvature(request.plot, fit)


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


def _text(fit: CurvatureFit) -> str:
    worst = max(fit.postures, key=lambda posture: posture.circle.rms)
    return (
        f"{len(fit.postures)} postures, arc length {fit.arc_length_mm[0]:g} to {fit.arc_length_mm[1]:g} mm\n"
        f"  a = {fit.a_per_mm:.6g} +- {fit.a_half_width_per_mm:.2g} /mm (95 %)\n"
        f"  b = {fit.b:.6g} +- {fit.b_half_width:.2g} (95 %)\n"
        f"  residual of epsilon: {fit.rms_epsilon:.4g} rms; worst circle {worst.name!r}: "
        f"{worst.circle.rms:.3g} mm rms"
    )


def _changes(fit: CurvatureFit, note: str) -> list[Change]:
    from contid.robot_file.edit import Change

    a_note = f"{note}, +- {fit.a_half_width_per_mm:.2g} (95 %)"
    b_note = f"{note}, +- {fit.b_half_width:.2g} (95 %)"
    return [
        Change("correction.a_per_mm", float(f"{fit.a_per_mm:.6g}"), a_note),
        Change("correction.b", float(f"{fit.b:.6g}"), b_note),
        Change("correction.arc_length_mm", [round(value, 4) for value in fit.arc_length_mm], note),
    ]
