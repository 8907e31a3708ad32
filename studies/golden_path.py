"""``python -m studies.golden_path``: the curve on which the CBHA's methods are compared, to follow."""

from __future__ import annotations

import sys

import click

from contid.cli.support.parameters import POSITIVE


@click.command()
@click.option("--period", type=POSITIVE, default=4.0, show_default=True, help="Time of one lap [s].")
@click.option("--laps", type=POSITIVE, default=1.0, show_default=True, help="How many laps.")
@click.option("--rate", type=POSITIVE, default=50.0, show_default=True, help="Rows per second.")
def command(period: float, laps: float, rate: float) -> None:
    """Print the golden trajectory of the CBHA, see `studies.bench_ik`: its place and size are fixed.

    python -m studies.golden_path --period 20 | contid run cbha --mock
    """
    from contid.units import m_to_mm
    from contid_paths.shapes import check_row_count
    from contid_paths.table import write_rows
    from studies.singh import golden_rows

    check_row_count(period, laps, rate)
    rows = ([time_s, *map(m_to_mm, tip)] for time_s, tip in golden_rows(period, laps, rate))
    write_rows(sys.stdout, ["t_s", "x_mm", "y_mm", "z_mm"], rows)


if __name__ == "__main__":
    command()
