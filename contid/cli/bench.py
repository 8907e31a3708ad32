"""``contid bench``: the figures of the documentation, measured on this machine."""

from __future__ import annotations

from importlib import import_module
from typing import Final

import click

#: Benchmark -> (module that defines it as ``command``, one line for ``contid bench --help``).
BENCHES: Final[dict[str, tuple[str, str]]] = {
    "ik": (
        "contid.cli.bench_ik",
        "inverse kinematics of the CBHA: the paper's Table I beside today's figures",
    ),
    "cosserat": (
        "contid.cli.bench_cosserat",
        "the pneumatic arm of Shi et al.: solve times, experiments 1-4 simulated",
    ),
}


class BenchGroup(click.Group):
    """The table of benchmarks, each imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return list(BENCHES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of one benchmark."""
        if cmd_name not in BENCHES:
            return None
        found: click.Command = import_module(BENCHES[cmd_name][0]).command
        return found

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table itself is the help."""
        with formatter.section("Benchmarks"):
            formatter.write_dl([(name, line) for name, (_, line) in BENCHES.items()])


@click.group(cls=BenchGroup)
def command() -> None:
    """Measure contid on this machine and print the result."""
