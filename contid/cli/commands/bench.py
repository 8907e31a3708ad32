"""``contid bench``: the figures of the documentation, measured on this machine."""

from __future__ import annotations

from typing import Final

from contid.cli.support.table import TableGroup

#: Benchmark -> (module that defines it as ``command``, one line for ``contid bench --help``).
BENCHES: Final[dict[str, tuple[str, str]]] = {
    "ik": (
        "studies.bench_ik",
        "inverse kinematics of the CBHA: the paper's Table I beside today's figures",
    ),
    "cosserat": (
        "studies.bench_cosserat",
        "the pneumatic arm of Shi et al.: solve times, experiments 1-4 simulated",
    ),
}


command = TableGroup(BENCHES, "Benchmarks", help="Measure contid on this machine and print the result.")
