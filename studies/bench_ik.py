"""``python -m studies.bench_ik``: Table I of Singh et al. (2017) and II of 2018 beside today's figures."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from studies.comparison import ComparisonRow, Drift
    from studies.shape_comparison import ShapeRow


@click.command(name="ik")
@click.option(
    "--network",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Neural network from `studies.train`; without one, one is trained first (ten seconds or so).",
)
@click.option("--no-network", is_flag=True, help="Leave the neural network out.")
@click.option("--random", default=200, show_default=True, type=click.IntRange(0), help="Random trajectories.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
def command(network: Path | None, no_network: bool, random: int, as_json: bool) -> None:
    """Compare the inverse kinematics of Singh et al. (ROBIO 2017) with contid's, on a simulated CBHA.

    Neither paper has robot data, tube distances or limits: everything but the columns "paper" is simulated
    with placeholders, and times are this machine's, from Python.
    """
    from studies.comparison import compare, drift, methods
    from studies.distal_learning import InverseNetwork, Recipe
    from studies.shape_comparison import compare_shapes
    from studies.train import trained

    net = None
    if not no_network:
        net = InverseNetwork.load(network) if network is not None else trained(Recipe())
    table = methods(net)
    with _progress(len(table)) as report:
        rows = compare(table, random, report)
    drifts = drift()
    shapes = compare_shapes()
    if as_json:
        for row in rows:
            click.echo(json.dumps({"kind": "method", **asdict(row)}))
        for entry in drifts:
            click.echo(json.dumps({"kind": "drift", **asdict(entry)}))
        for shape in shapes:
            click.echo(json.dumps({"kind": "shape", **asdict(shape)}))
        return
    _print(rows, drifts, random)
    _print_shapes(shapes)


def _print(rows: list[ComparisonRow], drifts: list[Drift], random: int) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if Console().is_terminal else 160)
    table = Table(
        title=f"CBHA, golden trajectory and {random} random ones (simulated; errors in mm, times in us)"
    )
    for name in (
        "method", "max |x|,|y|,|z|", "mean", "random median", "random worst", "outside limits", "time",
        "paper |x|,|y|,|z|", "paper time",
    ):  # fmt: skip
        table.add_column(name, justify="left" if name == "method" else "right")
    for row in rows:
        table.add_row(
            row.name,
            _three(row.max_mm),
            _one(row.mean_mm),
            _one(row.random_median_mm),
            _one(row.random_worst_mm),
            _one(row.outside_mm),
            "" if row.time_us is None else f"{row.time_us:.1f}",
            _three(row.paper_mm),
            "" if row.paper_us is None else f"{row.paper_us:.0f}",
        )
    console.print(table)
    timed = {row.name: row.time_us for row in rows if row.time_us is not None}
    newton = next(value for name, value in timed.items() if name.startswith("Newton"))
    ours = next(value for name, value in timed.items() if name.startswith("contid, bounded"))
    console.print(
        f"Newton-Raphson in NumPy takes {newton / ours:.0f} times as long as contid's bounded solver.\n"
    )
    why = Table(
        title="Why DLS as printed drifts: what its steps lose and never get back (mm, golden trajectory)"
    )
    for name in ("lambda", "point", "error", "damping", "linearisation", "error with feedback"):
        why.add_column(name, justify="right")
    for entry in drifts:
        why.add_row(
            f"{entry.damping:g}",
            str(entry.point),
            *(
                f"{value:.2f}"
                for value in (
                    entry.error_mm,
                    entry.from_damping_mm,
                    entry.from_linearisation_mm,
                    entry.with_feedback_mm,
                )
            ),
        )
    console.print(why)


def _print_shapes(rows: list[ShapeRow]) -> None:
    """Tables II and III of the paper of 2018: lengths of the tubes, with what each method is given."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="Tube lengths from the tip, golden trajectory (simulated; errors in mm, times in us)")
    for name in (
        "method", "is given", "totals max", "totals mean", "six max", "six mean",
        "tip max", "tip mean", "time", "paper max", "paper mean", "paper time",
    ):  # fmt: skip
        table.add_column(name, justify="left" if name in ("method", "is given") else "right")
    for row in rows:
        table.add_row(
            row.name,
            row.given,
            ", ".join(map(_one, row.max_mm)),
            ", ".join(map(_one, row.mean_mm)),
            _one(row.six_max_mm),
            _one(row.six_mean_mm),
            _one(row.tip_max_mm),
            _one(row.tip_mean_mm),
            f"{row.time_us:.1f}",
            _three(row.paper_max_mm),
            _three(row.paper_mean_mm),
            "" if row.paper_us is None else f"{row.paper_us:.0f}",
        )
    Console(width=None if Console().is_terminal else 160).print(table)


def _one(value: float | None) -> str:
    return "" if value is None else f"{value:.2g}" if value < 0.01 else f"{value:.2f}"


def _three(values: tuple[float, float, float] | None) -> str:
    return "" if values is None else ", ".join(_one(value) for value in values)


@contextmanager
def _progress(total: int) -> Iterator[Callable[[str], None]]:
    """One step per method, on stderr."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("comparing", total=total)
        started = False

        def report(name: str) -> None:
            nonlocal started
            progress.update(task, description=name, advance=1 if started else 0)
            started = True

        yield report


if __name__ == "__main__":
    command()
