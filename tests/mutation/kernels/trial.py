"""Tests against each mutant, in processes forked from one that has collected them."""

from __future__ import annotations

import ctypes
import signal
import sys
import time
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any, Final

import pytest
from _pytest.runner import runtestprotocol

from tests.mutation.forked import Forked, Result, results
from tests.mutation.kernels.build import LIBRARY

#: Times the processor time of its tests that a mutant may take; more is an endless loop.
TIMES_LONGER: Final = 10.0


class Library:
    """Which mutant is chosen in this process."""

    def __init__(self, folder: Path, count: int) -> None:
        library = ctypes.CDLL(str(folder / LIBRARY), mode=ctypes.RTLD_GLOBAL)
        self._chosen = ctypes.c_int.in_dll(library, "contid_mutant")
        self._reached = (ctypes.c_ubyte * (count + 1)).in_dll(library, "contid_mutant_reached")

    def choose(self, number: int) -> None:
        """Make one mutant the active one; 0 for none."""
        self._chosen.value = number

    def reached(self) -> list[int]:
        """The mutants whose place was reached since the last call."""
        numbers = [number for number, reached in enumerate(self._reached) if reached]
        ctypes.memset(self._reached, 0, len(self._reached))
        return numbers


def import_mutants(folder: Path) -> None:
    """Put the modules of a build in the place of `contid.kernels._NAME`."""
    import contid.kernels as kernels

    kernels.has_avx2 = lambda: False  # type: ignore[assignment]
    for path in sorted(folder.glob("build/contid/kernels/_*.so")):
        name = f"contid.kernels.{path.name.split('.')[0]}"
        spec = spec_from_file_location(name, path, loader=ExtensionFileLoader(name, str(path)))
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
        sys.modules[name] = module


class Trials:
    """A pytest plugin that runs the collected tests once for each mutant that they reach."""

    def __init__(self, library: Library, numbers: list[int], jobs: int, budget_s: float) -> None:
        self._library, self._numbers, self._jobs, self._budget_s = library, numbers, jobs, budget_s
        #: Mutant -> the test that detected it, "" for a survivor, None where no test reaches it.
        self.detected = dict[int, str | None]()

    @pytest.hookimpl
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """In the place of pytest's own loop."""
        items = session.items
        first = Forked(lambda: self._unmutated(items), log="/dev/null").wait()
        if "ended" in first:
            raise pytest.UsageError(f"the unmutated tests ended with {first['ended']}")
        usable = [at for at, each in enumerate(first["tests"]) if each["passed"]]
        print(f"{len(usable)} of {len(items)} tests pass unmutated; left out:", file=sys.stderr, flush=True)
        for at in sorted(set(range(len(items))) - set(usable)):
            print(f"  {items[at].nodeid}", file=sys.stderr, flush=True)
        chosen = dict[int, list[int]]()
        for number in self._numbers:
            reaching = [at for at in usable if number in first["tests"][at]["reached"]]
            reaching.sort(key=lambda at: float(first["tests"][at]["seconds"]))
            if reaching:
                chosen[number] = _within(
                    [(at, first["tests"][at]["seconds"]) for at in reaching], self._budget_s
                )
            else:
                self.detected[number] = None

        def start(number: int) -> Forked:
            tests = [items[at] for at in chosen[number]]
            limit_s = 5.0 + TIMES_LONGER * sum(first["tests"][at]["seconds"] for at in chosen[number])
            return Forked(lambda: self._mutated(number, tests), limit_s)

        for number, result in results(list(chosen), start, self._jobs):
            by = f"ended with {result['ended']}" if "ended" in result else result["by"]
            self.detected[number] = by
            print(f"{len(self.detected)}: {number} {by or 'SURVIVED'}", file=sys.stderr, flush=True)
        return True

    def _unmutated(self, items: list[pytest.Item]) -> Result:
        tests = list[dict[str, Any]]()
        for at, item in enumerate(items):
            begin_s = time.process_time()
            self._library.reached()
            passed = _passes(item, items[at + 1] if at + 1 < len(items) else None)
            seconds = time.process_time() - begin_s
            tests.append({"passed": passed, "seconds": seconds, "reached": self._library.reached()})
        return {"tests": tests}

    def _mutated(self, number: int, items: list[pytest.Item]) -> Result:
        self._library.choose(number)
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        for at, item in enumerate(items):
            if not _passes(item, items[at + 1] if at + 1 < len(items) else None):
                return {"by": item.nodeid}
        return {"by": ""}


def _passes(item: pytest.Item, following: pytest.Item | None) -> bool:
    reports = runtestprotocol(item, nextitem=following, log=False)
    return all(report.passed for report in reports)


def _within(tests: list[tuple[int, float]], budget_s: float) -> list[int]:
    """The first tests whose sum is within a budget of processor time; one at least."""
    kept, sum_s = list[int](), 0.0
    for test, seconds in tests:
        if kept and sum_s + seconds > budget_s:
            break
        kept.append(test)
        sum_s += seconds
    return kept
