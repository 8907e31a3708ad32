"""``contid reach``: areas or volumes that the tips of a robot file reach."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import FIGURE, POSITIVE, robot_names

if TYPE_CHECKING:
    from contid.robot_file.robot import RobotDescription
    from contid_reach.report import ReachReport


@click.command()
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--plot", type=FIGURE, help="Draw the regions into a .png, .svg or .pdf.")
@click.option("--voxel-mm", type=POSITIVE, help="Edge of a voxel (spatial arms).")
@click.option(
    "--across",
    type=click.IntRange(4, 200),
    default=24,
    show_default=True,
    help="Voxels along the widest side when --voxel-mm is not given.",
)
@click.option(
    "--quality",
    type=click.Choice(["compliance", "accuracy", "dexterity"]),
    help="Map how good the places are instead of how many there are.",
)
@click.option(
    "--axis-sigma",
    type=POSITIVE,
    help="Standard deviation of an axis [mm or bar], for --quality accuracy.",
)
@click.option("--json", "as_json", is_flag=True, help="The numbers as one JSON object.")
def command(
    robot_file: str,
    plot: Path | None,
    voxel_mm: float | None,
    across: int,
    quality: str | None,
    axis_sigma: float | None,
    as_json: bool,
) -> None:
    """Workspace of the tips of ROBOT_FILE: areas of planar robots (exact), volumes of spatial ones.

    For a hand of two rack fingers it also prints the comparison of Morita et al., section IV-B.

    With --quality it maps a measure of the places instead: compliance (how far the tip gives way to a
    newton), accuracy (standard deviation of the tip in its worst direction), or dexterity (1 where the tip
    moves alike in all directions, 0 where it cannot move in one).
    """
    from contid.cli.support.streams import counting
    from contid.errors import ContidError
    from contid.robot_file.load import load_named
    from contid.robot_file.rack_finger import RackFinger
    from contid_reach.report import planar_report, spatial_report

    loaded = load_named(robot_file)
    robots = loaded.driven
    if axis_sigma is not None and quality != "accuracy":
        raise click.UsageError("--axis-sigma is for --quality accuracy.")
    if plot is not None:
        _refuse_unwritable(plot)
    if quality is not None:
        _quality(loaded.file.name, robots, quality, axis_sigma, voxel_mm, across, as_json, plot)
        return
    fingers = {name: robot for name, robot in robots.items() if isinstance(robot, RackFinger)}
    arms = {name: robot for name, robot in robots.items() if name not in fingers}
    flat = [name for name, robot in arms.items() if robot.dimension == 2]
    if flat:
        raise ContidError(f"{', '.join(flat)}: no area for this planar model; allowed: rack_finger")
    reports = [planar_report(fingers)] if fingers else []
    if arms:
        with counting("voxels tested") as progress:
            reports.append(spatial_report(arms, voxel_mm, across, progress))
    if as_json:
        numbers = {key: value for each in reports for key, value in each.to_json().items()}
        click.echo(json.dumps({"file": loaded.file.name, **numbers}))
    for number, report in enumerate(reports):
        if not as_json:
            _print(report)
        if plot is not None:
            from contid_reach.plot import save_plot

            path = plot if number == 0 else plot.with_stem(f"{plot.stem}-{number + 1}")
            save_plot(report, path, f"{loaded.file.name}: reach of the tips")
            click.echo(f"drawn: {path}", err=True)


def _refuse_unwritable(path: Path) -> None:
    """Refuse a file that cannot be written, before the work for it.

    Raises:
        ContidError: with the reason of the system.
    """
    from contid.errors import ContidError

    try:
        with path.open("ab") if path.exists() else tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise ContidError(f"{path}: cannot write it: {error.strerror or error}") from error


def _quality(
    file: str,
    robots: Mapping[str, RobotDescription],
    quality: str,
    axis_sigma: float | None,
    voxel_mm: float | None,
    across: int,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Print the map of a measure for every robot, and draw it."""
    from contid.cli.support.streams import counting
    from contid.units import MM_PER_M
    from contid_reach.quality import Measure, quality_map
    from contid_reach.quality_report import to_json, to_text

    measure, maps = Measure(quality), {}
    with counting("places tested") as progress:
        for name, robot in robots.items():
            maps[name] = quality_map(
                name, robot, measure,
                axis_sigma=None if axis_sigma is None else robot.quantity.to_si(axis_sigma),
                edge_m=None if voxel_mm is None else voxel_mm / MM_PER_M,
                across=across, progress=progress,
            )  # fmt: skip
    if as_json:
        click.echo(json.dumps({"file": file, **to_json(maps)}))
    else:
        for line in to_text(maps):
            click.echo(line)
    if plot is not None:
        from contid_reach.quality_plot import save_quality_plot

        save_quality_plot(maps, plot, f"{file}: {quality}")
        click.echo(f"drawn: {plot}", err=True)


def _print(report: ReachReport) -> None:
    from contid_reach.report import PAPER_OVERLAP_CM2, PAPER_TWO_LINK_CM2, with_unit

    for name, area in report.areas_cm2.items():
        click.echo(f"{name}: {area:.4f} cm2")
    for name, volume in report.volumes.items():
        low, high = ([f"{value * 1e3:.0f}" for value in corner] for corner in volume.bounds_m())
        click.echo(
            f"{name}: {with_unit(volume.volume_m3, volume.uncertainty_m3)} "
            f"({len(volume.voxels)} voxels of {volume.edge_m * 1e3:.3g} mm), "
            f"from ({', '.join(low)}) to ({', '.join(high)}) mm"
        )
    unit = "cm2" if report.areas_cm2 else "cm3"
    for (a, b), shared in report.overlaps.items():
        click.echo(f"{a} and {b}: {shared:.4f} {unit} in common")
    if report.comparison:
        printed = (PAPER_OVERLAP_CM2, *PAPER_TWO_LINK_CM2.values())
        click.echo("\nOverlap as Morita et al. compare it in section IV-B (paper's figure):")
        for (line, area), paper in zip(report.comparison.items(), printed, strict=True):
            click.echo(f"  {line}: {area:.6g} cm2 ({paper:.2f})")
        click.echo(
            "  The paper's 14.77 cm2 needs a tip length or rack spacing it does not print; its two-link\n"
            "  figures reproduce with joints that turn to both sides."
        )
