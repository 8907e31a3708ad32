"""Mutants of the tick: how many of a random sample of small changes the tests detect.

``python -m tests.mutation [--sample N] [--seed S] [--jobs J] [--write]`` draws N mutants of
``contid/control/tick`` with operators of Cosmic Ray and runs, for each, the tests that execute its line. A
mutant survives when all of them pass. Exit 1 when more survive than the share in ``baseline.json`` allows;
``--write`` writes that file. The results are kept in ``build/mutation``: an interrupted run goes on, and
after a change of tests only the mutants run again that they concern. Needs ``pip install '.[mutation]'``.
"""

from __future__ import annotations

import argparse
import os
import sys
import time

from tests.mutation.baseline import FOLDER, UNTESTED, Baseline, Journal
from tests.mutation.executed import SUITES, measured
from tests.mutation.mutants import (
    Mutant,
    change,
    fingerprint_of_the_rest,
    modules,
    mutants,
    mutated,
    sampled,
)
from tests.mutation.selection import Selection
from tests.mutation.trial import Task, preload, run


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description="Mutants of the tick.")
    parser.add_argument("--sample", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--budget", type=float, default=30.0, help="processor time of tests per mutant [s]")
    parser.add_argument("--module", default="", help="only mutants of modules whose path begins with this")
    parser.add_argument("--write", action="store_true", help="write baseline.json")
    asked = parser.parse_args()
    sources = modules()
    every = [mutant for mutant in mutants(sources) if mutant.module.startswith(asked.module)]
    drawn, baseline = sampled(every, asked.sample, asked.seed), Baseline()
    sample = [mutant for mutant in drawn if not baseline.is_equivalent(sources[mutant.module], mutant)]
    journal = detected(sample, sources, asked.jobs, asked.budget)
    survivors = [mutant for mutant in sample if journal.found[mutant.name] in ("", UNTESTED)]
    for mutant in sorted(survivors, key=lambda each: (each.module, each.line)):
        was, now = change(sources[mutant.module], mutant)
        print(f"{mutant.module}:{mutant.line} {journal.found[mutant.name]}\n  - {was}\n  + {now}")
    if asked.write:
        baseline.write(len(every), asked.seed, len(drawn), sample, survivors, sources)
        return 0
    allowed = baseline.allowed(len(sample))
    print(f"{len(drawn)} mutants, {len(drawn) - len(sample)} of them equivalent; of the other {len(sample)}")
    print(f"{len(survivors)} survived, {allowed:.1f} allowed")
    return int(len(survivors) > allowed)


def detected(sample: list[Mutant], sources: dict[str, str], jobs: int, budget_s: float) -> Journal:
    """Run all mutants of a sample that the journal does not have yet."""
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    preload()
    executed = measured(FOLDER / "executed")
    selection = Selection(sources, executed, budget_s)
    found, begin_s = Journal(FOLDER / f"{fingerprint_of_the_rest()}.jsonl"), time.monotonic()
    tasks = dict[str, Task]()
    progress = os.fdopen(os.dup(1), "w")  # pytest has the output of its process
    for mutant in sample:
        selected = selection.of(mutant)
        if found.has(mutant, selected.tests):
            continue
        if selected.tests:
            text = mutated(sources[mutant.module], mutant)
            tasks[mutant.name] = Task(mutant, text, selected.tests, selected.cold)
        else:
            found.keep(mutant, UNTESTED, ())

    def keep(mutant: Mutant, by: str) -> None:
        found.keep(mutant, by, tasks[mutant.name].tests)
        seconds = time.monotonic() - begin_s
        print(f"{mutant.name} {by or 'survived'} ({seconds:.0f} s)", file=progress, flush=True)

    run(list(tasks.values()), SUITES, executed.times_s, jobs, str(FOLDER / "log"), keep)
    return found.again()


if __name__ == "__main__":
    sys.exit(main())
