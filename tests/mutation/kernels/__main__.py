"""Mutants of the C++ kernels: how many of a random sample of small changes the tests detect.

``python -m tests.mutation.kernels [--sample N] [--seed S] [--part FOLDER] [--jobs J] [TESTS...]`` compiles
N mutants into one build and runs, for each, the tests that reach it, the quickest first, until one fails.
Prints the survivors; exit 1 when more than 15 % of the sample survive.
"""

from __future__ import annotations

import argparse
import os
import sys
from typing import Final

import pytest

from tests.mutation.kernels.build import ROOT, built
from tests.mutation.kernels.trial import Library, Trials, import_mutants

#: Tests that run the kernels in their own process.
TESTS: Final = (
    "tests/kernels",
    "tests/kinematics",
    "tests/clearance",
    "tests/api",
    "tests/oracles",
    "tests/drivers/sim",
)
ALLOWED: Final = 0.15


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m tests.mutation.kernels", description="Mutants of the kernels."
    )
    parser.add_argument("--sample", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--part", default="", help="only files in contid/kernels whose path begins with this")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--budget", type=float, default=60.0, help="processor time of tests per mutant [s]")
    parser.add_argument("tests", nargs="*", default=TESTS)
    asked = parser.parse_args()
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    folder, numbered = built(asked.sample, asked.seed, asked.part)
    print(f"{len(numbered)} mutants compiled", file=sys.stderr, flush=True)
    library = Library(folder, max(numbered))
    import_mutants(folder)
    trials = Trials(library, list(numbered), asked.jobs, asked.budget)
    where = [str(ROOT / test) for test in asked.tests if (ROOT / test).exists()]
    options = [
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-p",
        "no:rerunfailures",
        "--rootdir",
        str(ROOT),
    ]
    pytest.main([*options, *where], plugins=[trials])
    survivors = [number for number, by in trials.detected.items() if not by]
    for number in sorted(survivors, key=lambda each: numbered[each].name):
        print(f"{numbered[number].name}{'' if trials.detected[number] == '' else ' (no test reaches it)'}")
    share = len(survivors) / max(1, len(numbered))
    print(f"{len(survivors)} of {len(numbered)} survived ({share:.1%}); {ALLOWED:.0%} allowed")
    return int(share > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
