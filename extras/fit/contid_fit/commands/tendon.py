"""``contid calibrate tendon``: geometry, stiffness and friction of a tendon robot from tips over pulls."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

import click

from contid.cli.support.parameters import NumberRange
from contid.errors import ContidError
from contid_fit.commands.calibration import MEASUREMENTS, Calibration, calibration, lines_of, source_of

if TYPE_CHECKING:
    from contid_fit.calibrate.tendon.geometry import FoundGeometry
    from contid_fit.calibrate.tendon.recording import TendonRecording
    from contid_fit.calibrate.tendon.stages import Stage

#: Groups of the printed table; all others are in ``--json``.
_PRINTED: Final = ("radius_mm", "angle_deg", "length_mm", "stiffness_mm2", "friction_mm2", "play_mm")


@calibration("tendon")
@click.option("--held-out", type=MEASUREMENTS, help="Rows to predict that follow DATA.")
@click.option(
    "--keep-out",
    type=NumberRange(0.0, 0.5),
    default=0.2,
    show_default=True,
    help="Share of DATA to predict instead, its last rows.",
)
def command(request: Calibration, held_out: TextIO | None, keep_out: float) -> None:
    """Fit a tendon robot to DATA: a CSV of pulls and tips, or a session (.mcap) with measured tips.

    Columns: timestamp, pattern_label, one servo_<id>_mm per tendon, and tip_x,tip_y,tip_z in mm. Pulls of one
    tendon while all others are slack show which servo pulls which tendon; without them the columns must be in
    the order of the axes. Load cells at both ends of a tendon, servo_<id>_near_n and servo_<id>_far_n in N,
    give the capstan coefficient. Each stage is judged by the rows kept out.
    """
    from contid.robot_file.tendon.robot import TendonRobot
    from contid_fit.calibrate.tendon.fit_robot import calibrate
    from contid_fit.calibrate.tendon.result import changes, friction_changes, friction_predicts

    name, robot = request.find(TendonRobot, "tendon robot")
    if robot.drives is not None:
        raise ContidError(
            f"{name}: drives: contid calibrate tendon fits robots with a motor per tendon; "
            "studies/moving/trunk_statics.py shows a fit of a robot with drives"
        )
    training = _read(request.data, name)
    other = None if held_out is None else _read(held_out, name)
    found = calibrate(robot, training, other, keep_out)
    if request.as_json:
        click.echo(json.dumps(_numbers(found.geometry, found.both, found.stages)))
    else:
        _print(found.geometry, found.both, found.stages)
    # Friction is added to a file that has none only where it predicts better.
    last, add = found.stages[-1], friction_predicts(found.stages)
    edits = changes(last, robot, found.both.servos, found.geometry, request.note)
    fitted = found.both.rows(0, last.train.rows)
    edits += friction_changes(last, robot, fitted, request.note, add)
    request.write_back(name, edits, measured=("geometry.sections",))
    if request.plot is not None:
        from contid_fit.calibrate.tendon.plot import plot_stages

        plot_stages(request.plot, found.stages, found.both)


def _read(data: TextIO, robot: str) -> TendonRecording:
    source = source_of(data)
    if source.endswith(".mcap"):
        from contid_fit.commands.tendon_session import session_recording

        return session_recording(Path(source), robot)
    from contid_fit.calibrate.tendon.recording import read_recording

    return read_recording(lines_of(data), source)


def _numbers(
    geometry: FoundGeometry | None, both: TendonRecording, stages: tuple[Stage, ...]
) -> dict[str, object]:
    from contid_fit.calibrate.tendon.capstan import capstan_coefficient, measured_capstan
    from contid_fit.calibrate.tendon.result import millimetres, numbers

    last = stages[-1]
    parameters: dict[str, dict[str, dict[str, float]]] = {}
    for each in numbers(last):
        value = {"value": each.value, "low": each.low, "high": each.high}
        parameters.setdefault(each.name, {})[each.label] = value
    penalty = last.residual.penalty if last.residual is not None else float("inf")
    # One section alone has no servos to exchange; JSON has no infinity.
    margin = None if geometry is None or geometry.margin == float("inf") else geometry.margin
    fitted = both.rows(0, last.train.rows)
    mu, ends = capstan_coefficient(last.fit, fitted.pull_m), measured_capstan(last.fit, fitted)
    return {
        "capstan": None if mu is None else asdict(mu),
        "capstan_from_ends": None if ends is None else asdict(ends),
        "servos": list(both.servos),
        "geometry_margin": margin,
        "confidence": 0.95,
        "stages": [
            {"name": stage.name, "train": millimetres(stage.train), "held_out": millimetres(stage.held_out)}
            for stage in stages
        ],
        "residual_accepted": penalty != float("inf"),
        "parameters": parameters,
    }


def _print(geometry: FoundGeometry | None, both: TendonRecording, stages: tuple[Stage, ...]) -> None:
    from contid_fit.calibrate.tendon.result import numbers

    first = stages[0].train.rows
    click.echo(f"{first} rows fitted, {len(both) - first} kept out; tip errors in mm: RMSE, mean")
    for stage in stages:
        line = f"  {stage.name:20s} {1e3 * stage.train.rmse_m:6.2f} {1e3 * stage.train.mean_m:6.2f}"
        if stage.held_out is not None:
            low, high = stage.held_out.rmse_95_m
            line += f"   kept out {1e3 * stage.held_out.rmse_m:6.2f} ({1e3 * low:.1f} to {1e3 * high:.1f})"
            line += f" {1e3 * stage.held_out.mean_m:6.2f}"
        if not stage.fit.converged:
            line += "   not converged"
        click.echo(line)
    last = stages[-1]
    if last.residual is not None and last.residual.penalty == float("inf"):
        click.echo("  no residual predicts patterns kept out better than none; it stays off")
    _print_friction(both, stages)
    if geometry is None:
        click.echo("no tendon is pulled alone: columns are taken in the order of the axes")
    else:
        order = ", ".join(
            f"{tendon} {servo}" for tendon, servo in zip(_axes(stages), both.servos, strict=True)
        )
        click.echo(f"tendons: {order}")
    for each in numbers(last):
        if each.name in _PRINTED:
            interval = f"{each.low:.4g} to {each.high:.4g} (95 %)"
            click.echo(f"  {each.name:14s} {each.label:8s} {each.value:10.4g}   {interval}")


def _print_friction(both: TendonRecording, stages: tuple[Stage, ...]) -> None:
    from contid_fit.calibrate.tendon.capstan import capstan_coefficient, measured_capstan
    from contid_fit.calibrate.tendon.result import friction_predicts

    last = stages[-1]
    fitted = both.rows(0, last.train.rows)
    for found, source in (
        (capstan_coefficient(last.fit, fitted.pull_m), "of the friction"),
        (measured_capstan(last.fit, fitted), "from the tensions at both ends"),
    ):
        if found is not None:
            interval = f"{found.low:.2g} to {found.high:.2g} (95 %)"
            click.echo(f"  capstan coefficient {source} {found.value:.3g}   {interval}")
    if not friction_predicts(stages):
        click.echo("  friction does not predict better; it is written only where the file has it")


def _axes(stages: tuple[Stage, ...]) -> tuple[str, ...]:
    """Names of the tendons."""
    groups = stages[-1].fit.model.parameters.groups
    return next(each.labels for each in groups if each.name == "radius_m")
