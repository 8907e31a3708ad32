"""``python -m studies.train``: the network of Singh et al.'s comparison, by distal supervised learning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import NumberRange

if TYPE_CHECKING:
    from studies.distal_learning import InverseNetwork, Recipe


@click.command(name="train")
@click.argument("output", type=click.Path(dir_okay=False, path_type=Path))
@click.option(
    "--hidden", default=30, show_default=True, type=click.IntRange(1, 500), help="Neurons per network."
)
@click.option(
    "--levels",
    default=4,
    show_default=True,
    type=click.IntRange(2, 6),
    help="Pressures per tube; levels^6 samples.",
)
@click.option("--noise-mm", default=1.0, show_default=True, type=NumberRange(0), help="Noise of the tip.")
@click.option(
    "--iterations", default=1500, show_default=True, type=click.IntRange(1), help="At most, per network."
)
@click.option("--seed", default=1, show_default=True, help="Of weights, noise and the split of the data.")
def command(output: Path, hidden: int, levels: int, noise_mm: float, iterations: int, seed: int) -> None:
    """Train an inverse network of the simulated CBHA and save it as OUTPUT (.npz), for `studies.bench_ik`."""
    from contid.units import mm_to_m
    from studies.distal_learning import Recipe

    recipe = Recipe(hidden, levels, mm_to_m(noise_mm), iterations, seed)
    network = trained(recipe)
    network.save(output)
    click.echo(
        f"{output}: {hidden} neurons, mean tip error {network.trained_mm:.2f} mm on the test set (simulated)",
        err=True,
    )


def trained(recipe: Recipe) -> InverseNetwork:
    """Train with a progress bar on stderr."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from studies.distal_learning import train

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[error]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        tasks = {}

        def report(what: str, iteration: int, error_mm: float) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=recipe.iterations, error="")
            progress.update(tasks[what], completed=iteration, error=f"{error_mm:.2f} mm")

        return train(recipe, report)


if __name__ == "__main__":
    command()
