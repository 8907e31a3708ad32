"""Tip errors of tendon-robot models on the recordings of two real robots, stage by stage, beside black boxes.

    python -m studies.tendon_recordings FOLDER

FOLDER holds ``ftdcr_v4`` and ``ftdcr_v6`` of https://github.com/ContinuumRoboticsLab/opencr-mujoco (MIT).
The split: ftdcr_v4 is fitted to ``train.csv`` (geometry: ``tendon_pull.csv``) and predicts ``val.csv``, all
three sections together, which the training rows never show; ftdcr_v6 is fitted to the first 80 % of its
``train.csv`` and predicts the rest; if it has a ``val.csv``, too, ftdcr_v6 is also fitted to all of its
``train.csv`` and predicts that. Every choice (form of the model, penalties, expectations) is made
inside the training rows; the rows kept out are read here only, and each model predicts them once, from
pulls alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click
import numpy as np

from contid_fit.calibrate.tendon.accuracy import Accuracy, accuracy
from contid_fit.calibrate.tendon.geometry import find_geometry, nominal_of
from contid_fit.calibrate.tendon.models import Nominal
from contid_fit.calibrate.tendon.recording import TendonRecording, read_recording
from contid_fit.calibrate.tendon.stages import run_stages, split_rows
from studies.tendon_black_boxes import black_boxes

COUNT: Final = (3, 3, 3)
RADIUS_M: Final = 4.5e-3
V6_KEPT_OUT: Final = 0.2


@dataclass(frozen=True, slots=True)
class RecordedRobot:
    """A recorded robot; lengths of its sections [m] as its authors print them."""

    name: str
    length_m: tuple[float, float, float]


V4: Final = RecordedRobot("ftdcr_v4", (0.060, 0.0625, 0.064))
V6: Final = RecordedRobot("ftdcr_v6", (0.100, 0.100, 0.022))


@dataclass(frozen=True, eq=False)
class Split:
    """Rows to fit and rows kept out, with the columns in the order of the tendons."""

    training: TendonRecording
    held_out: TendonRecording
    nominal: Nominal


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the table."""

    name: str
    train: Accuracy
    held_out: Accuracy


def read(folder: Path, robot: RecordedRobot, file: str) -> TendonRecording:
    """One recording."""
    path = folder / robot.name / file
    with path.open(encoding="utf-8") as lines:
        return read_recording(lines, f"{robot.name}/{file}")


def splits(folder: Path, robot: RecordedRobot) -> Iterator[Split]:
    """The splits of the module's first lines."""
    training = read(folder, robot, "train.csv")
    if robot is V6:
        first, rest = split_rows(training, V6_KEPT_OUT)
        assert rest is not None
        yield split(folder, robot, first, rest)
    if robot is V4 or (folder / robot.name / "val.csv").exists():
        yield split(folder, robot, training, read(folder, robot, "val.csv"))


def split(folder: Path, robot: RecordedRobot, training: TendonRecording, held_out: TendonRecording) -> Split:
    """Columns in the order of the tendons, by the pulls of one tendon."""
    found = find_geometry(read(folder, robot, "tendon_pull.csv"), COUNT)
    assert found is not None
    angles = np.array([each.angle_rad for each in found.tendons])
    training = training.in_order(found.columns)
    nominal = nominal_of(training, robot.length_m, RADIUS_M, angles, COUNT)
    return Split(training, held_out.in_order(found.columns), nominal)


def table(rows: Split) -> Iterator[Line]:
    """Each black box and each stage, with its errors."""
    both = rows.training.followed_by(rows.held_out)
    runs, first = both.runs, len(rows.training)
    for name, tip_m in black_boxes(rows.training, rows.held_out):
        error = tip_m - both.tip_m
        yield Line(name, accuracy(error[:first], runs[:first]), accuracy(error[first:], runs[first:]))
    for stage in run_stages(rows.training, rows.held_out, rows.nominal):
        assert stage.held_out is not None
        yield Line(stage.name, stage.train, stage.held_out)


def text(line: Line) -> str:
    """A line of the table in mm: RMSE after removing the mean offset / mean error, and their intervals."""
    train, kept = line.train, line.held_out
    low, high = (1e3 * each for each in kept.rmse_95_m)
    mean_low, mean_high = (1e3 * each for each in kept.mean_95_m)
    return (
        f"| {line.name} | {1e3 * train.rmse_m:.2f} / {1e3 * train.mean_m:.2f} "
        f"| {1e3 * kept.rmse_m:.2f} ({low:.1f} to {high:.1f}) "
        f"| {1e3 * kept.mean_m:.2f} ({mean_low:.1f} to {mean_high:.1f}) |"
    )


@click.command(help=__doc__)
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--robot", type=click.Choice([V4.name, V6.name]), multiple=True, help="Only this one.")
def main(folder: Path, robot: tuple[str, ...]) -> None:
    """Print the tables."""
    for each in (V4, V6):
        if robot and each.name not in robot:
            continue
        for rows in splits(folder, each):
            click.echo(f"{each.name}: {len(rows.training)} rows fitted, {len(rows.held_out)} kept out [mm]")
            click.echo("| model | train RMSE / mean | held out RMSE (95 %) | held out mean (95 %) |")
            click.echo("|---|---|---|---|")
            for line in table(rows):
                click.echo(text(line))


if __name__ == "__main__":
    main()
