"""``python -m studies.bench_cosserat``: speed and the experiments of Shi et al., simulated."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, TypeVar

import click

if TYPE_CHECKING:
    from rich.console import Console

    from studies.shi_cold import Cold
    from studies.shi_experiments import ExperimentRow
    from studies.shi_speed import Speed

_Item = TypeVar("_Item")


@click.command(name="cosserat")
@click.option("--speed/--no-speed", default=True, help="Times of solves beside the paper's formulation.")
@click.option("--errors/--no-errors", default=True, help="Experiments 1-4 on a simulated plant.")
@click.option(
    "--points", default=2000, show_default=True, type=click.IntRange(50), help="Points of a timed run."
)
@click.option(
    "--paper-points", default=20, show_default=True, type=click.IntRange(3), help="Of the baseline."
)
@click.option(
    "--trials", default=10, show_default=True, type=click.IntRange(1), help="Trials per trajectory."
)
@click.option("--samples", default=100, show_default=True, type=click.IntRange(10), help="Points of a trial.")
@click.option("--cold/--no-cold", default=True, help="Random reachable targets from a fixed start.")
@click.option(
    "--targets", default=2000, show_default=True, type=click.IntRange(10), help="Cold starts a mode."
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
def command(
    speed: bool,
    errors: bool,
    cold: bool,
    points: int,
    paper_points: int,
    targets: int,
    trials: int,
    samples: int,
    as_json: bool,
) -> None:
    """Time the pneumatic arm's inverse statics and repeat Shi et al.'s experiments 1-4 in simulation.

    Times are this machine's, from Python. Errors are of a simulated plant with wrong parameters, hysteresis
    and 0.03 bar of pressure error; the paper's figures beside them were measured on a robot.
    """
    from contid.cli.support.streams import counting
    from studies.shi_cold import campaign
    from studies.shi_experiments import experiments
    from studies.shi_paths import runs
    from studies.shi_speed import measure_all

    with counting("trajectories") as report:
        speeds = _collect(measure_all(points, paper_points), report) if speed else []
        colds = _collect(campaign(targets), report) if cold else []
        rows = _collect(experiments(runs(samples), trials), report) if errors else []
    if as_json:
        for entry in speeds:
            click.echo(
                json.dumps(
                    {"kind": "speed", **asdict(entry), "ratio": entry.ratio, "scipy_ratio": entry.scipy_ratio}
                )
            )
        for start in colds:
            click.echo(json.dumps({"kind": "cold", **asdict(start)}))
        for row in rows:
            click.echo(json.dumps({"kind": "experiment", **asdict(row)}))
        return
    if speeds:
        _print_speeds(speeds)
    if colds:
        _print_colds(colds)
    if rows:
        _print_rows(rows, trials)


def _collect(found: Iterator[_Item], report: Callable[[int], None]) -> list[_Item]:
    result = []
    for item in found:
        result.append(item)
        report(len(result))
    return result


def _print_speeds(speeds: list[Speed]) -> None:
    from rich.table import Table

    table = Table(title="Warm-started solves called from Python (us), stability and error estimate included")
    for heading in ("trajectory", "g", "median", "p99", "p99 of best laps", "max", "unmet"):
        table.add_column(heading, justify="left" if heading == "trajectory" else "right")
    for heading in ("paper's formulation, its rule", "faster", "scipy's tolerances", "faster"):
        table.add_column(heading, justify="right")
    for s in speeds:
        table.add_row(
            s.name, f"{s.grams:g}", f"{s.median_us:.1f}", f"{s.p99_us:.1f}", f"{s.best_p99_us:.1f}",
            f"{s.worst_us:.0f}", str(s.unmet), f"{s.paper_us:.0f} ({s.paper_met}/{s.paper_points} met)",
            f"{s.ratio:.0f}x", f"{s.scipy_us:.0f}", f"{s.scipy_ratio:.0f}x",
        )  # fmt: skip
    _console().print(table)


def _print_colds(colds: list[Cold]) -> None:
    from rich.table import Table

    table = Table(title="Cold starts from 0.5 bar: random reachable targets, loads tip down")
    for heading in ("mode", "g", "targets", "not met", "wrong claims", "median us", "p99 us", "max us"):
        table.add_column(heading, justify="left" if heading == "mode" else "right")
    for c in colds:
        table.add_row(
            c.mode, f"{c.grams:g}", str(c.targets), str(c.failures), f"{c.wrong_claims} of {c.checked}",
            f"{c.median_us:.0f}", f"{c.p99_us:.0f}", f"{c.worst_us:.0f}",
        )  # fmt: skip
    _console().print(table)


def _print_rows(rows: list[ExperimentRow], trials: int) -> None:
    from rich.table import Table

    table = Table(title=f"Experiments 1-4, SIMULATED ({trials} trials; mm and degrees); paper: measured")
    for heading in ("exp", "trajectory", "tip median", "tip max", "tip RMSE", "mid median", "mid max"):
        table.add_column(heading, justify="left" if heading == "trajectory" else "right")
    for heading in ("angle RMSE", "angle max", "model's residual"):
        table.add_column(heading, justify="right")
    table.add_column("paper (measured)")
    for r in rows:
        table.add_row(
            str(r.experiment), r.name, f"{r.tip_median:.2f}", f"{r.tip_max:.2f}", f"{r.tip_rmse:.2f}",
            _cell(r.mid_median), _cell(r.mid_max), _cell(r.angle_rmse), _cell(r.angle_max),
            f"{r.model_max:.1e}" + (f", {r.unmet} unmet" if r.unmet else ""), r.paper,
        )  # fmt: skip
    _console().print(table)


def _cell(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _console() -> Console:
    from rich.console import Console

    return Console(width=None if Console().is_terminal else 170)


if __name__ == "__main__":
    command()
