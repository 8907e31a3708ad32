"""``contid fault``: the table of faults, or one of them."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("number", required=False, type=int)
@click.option(
    "--write", type=click.Path(file_okay=False), help="Write the pages of faults and states below a folder."
)
def command(number: int | None, write: str | None) -> None:
    """Print cause, reaction and remedy of a fault; without NUMBER, the table of all."""
    from contid.cli.support import docs_pages
    from contid.control.tick.faults import PAGES, markdown

    if write is not None:
        for path in docs_pages.write(Path(write)):
            click.echo(path, err=True)
        return
    by_number = {int(fault): fault for fault in PAGES}
    if number is None:
        click.echo(markdown(), nl=False)
    elif number in by_number:
        click.echo(docs_pages.fault_page(by_number[number]), nl=False)
    else:
        raise click.BadParameter(f"no fault {number}; there are {', '.join(map(str, by_number))}")
