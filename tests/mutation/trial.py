"""Runs chosen tests on one mutant after the other, each in a fork, and finds which test fails first."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, Final

import pytest
from hypothesis import Phase, settings

from tests.mutation.forked import Forked, Result, results
from tests.mutation.mutants import ROOT, Mutant
from tests.mutation.replaced import functions_of_the_tick, import_from, patch

#: Packages below the tick, and of others, that the tests of the tick import.
PRELOADED: Final = (
    *("contid.robot_file.load", "contid.robot_file.load", "contid_clearance.walk", "contid.hal"),
    *("contid.kinematics.extra_axes", "contid.trajectory.read", "contid.trajectory.approach"),
    *("numpy", "psutil", "mcap.reader", "mcap.writer", "zstandard", "lz4.frame", "scipy.optimize"),
    *("hypothesis.strategies", "rich.console", "click", "asyncio", "multiprocessing.resource_tracker"),
)
#: Fixtures of tests/support/plugins that look for leaks; the tick opens nothing.
_LEAKS: Final = frozenset({"nothing_left_behind", "garbage_of_other_modules"})
#: A test may take this many times its unmutated processor time, and this much more [s].
TIMES: Final = 4.0
MORE_S: Final = 2.0
#: Processor time for importing and collecting [s].
_IMPORTS_S: Final = 30.0
#: A module of the tick may end with _test: pytest would import its file instead of the mutant.
_OPTIONS: Final = (
    *("-o", "python_files=test_*.py"),
    *("-x", "-q", "-p", "no:cacheprovider", "-o", "timeout=0", "--hypothesis-profile=mutants"),
    *("-W", "ignore:Module already imported:pytest.PytestAssertRewriteWarning"),
)


@dataclass(frozen=True)
class Task:
    """What is run for one mutant.

    Attributes:
        mutant: the change.
        source: text of its module with the change.
        tests: node ids in their order.
        cold: the change takes effect at import.
    """

    mutant: Mutant
    source: str
    tests: Sequence[str]
    cold: bool


class TookTooLongError(BaseException):
    """A test needs far more processor time than without the mutant."""


class Tests:
    """Plugin of pytest: the tests to run, each within its time; keeps the first that failed.

    Args:
        times_s: unmutated processor time of tests; those without one have no limit.
        chosen: node ids in their order; None for all that are collected.
    """

    __test__ = False

    def __init__(self, times_s: dict[str, float], chosen: Sequence[str] | None = None) -> None:
        self._times_s = times_s
        self._chosen = chosen
        self.items: dict[str, pytest.Item] = {}
        self.failed = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        self.items = {item.nodeid: item for item in items if not item.get_closest_marker("realtime")}
        for item in items:
            names = getattr(item, "fixturenames", [])
            names[:] = [name for name in names if name not in _LEAKS]
        chosen = list(self.items) if self._chosen is None else self._chosen
        items[:] = list(dict.fromkeys(item for name in chosen for item in self._called(name)))

    def _called(self, name: str) -> list[pytest.Item]:
        """The test of a name; where the mutant changed its parameters, all with this function."""
        if name in self.items:
            return [self.items[name]]
        return [item for each, item in self.items.items() if each.split("[")[0] == name.split("[")[0]]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        time_s = self._times_s.get(item.nodeid)
        signal.setitimer(signal.ITIMER_PROF, 0.0 if time_s is None else TIMES * time_s + MORE_S, 1.0)
        try:
            return (yield)
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid


class _Warm:
    """Plugin of pytest: where all is imported and collected, calls a function instead of running tests."""

    def __init__(self, run: Callable[[pytest.Session], None]) -> None:
        self._run = run

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        self._run(session)
        return True


def preload() -> None:
    """Import what the forks need and mutants do not change."""
    for name in PRELOADED:
        importlib.import_module(name)
    assert not [name for name in sys.modules if name.startswith("contid.control")]
    signal.signal(signal.SIGPROF, _too_long)
    settings.register_profile(
        "mutants", deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate)
    )


def session(paths: Iterable[str], plugins: Sequence[Any]) -> int:
    """Run pytest in this process; its exit code."""
    os.chdir(ROOT)
    return int(pytest.main([*_OPTIONS, *paths], list(plugins)))


def run(
    tasks: Sequence[Task],
    paths: Sequence[str],
    times_s: dict[str, float],
    jobs: int,
    log: str,
    keep: Callable[[Mutant, str], None],
) -> None:
    """Run all tasks.

    Args:
        tasks: what is run.
        paths: of all tests.
        times_s: unmutated processor time of every test.
        jobs: processes at once.
        log: where the output of pytest goes.
        keep: called with every mutant and the test that detected it, "" for none.
    """

    def limit_s(task: Task) -> float:
        return _IMPORTS_S + sum(TIMES * times_s[name] + MORE_S for name in task.tests)

    def cold(task: Task) -> Result:
        import_from(task.mutant.module, task.source)
        tests = Tests(times_s, task.tests)
        code = session(dict.fromkeys(name.split("::")[0] for name in task.tests), [tests])
        return {"failed": "" if code == 0 else tests.failed or f"exit code {code}"}

    def warm() -> Result:
        tests = Tests(times_s)
        session(paths, [tests, _Warm(lambda of: each_patched(of, tests))])
        return {}

    def each_patched(of: pytest.Session, tests: Tests) -> None:
        functions = functions_of_the_tick()
        gc.freeze()

        def patched(task: Task) -> Result:
            patch(functions, task.mutant.module, task.source)
            return {"failed": _first_failure(of, tests, task.tests)}

        inside = [task for task in tasks if not task.cold]
        for task, result in results(inside, lambda each: Forked(lambda: patched(each), limit_s(each)), jobs):
            keep(task.mutant, _detected(result))

    outside = [task for task in tasks if task.cold]
    for task, result in results(outside, lambda each: Forked(lambda: cold(each), limit_s(each), log), jobs):
        keep(task.mutant, _detected(result))
    if len(outside) < len(tasks):
        ended = Forked(warm, log=log).wait()
        if ended:
            raise RuntimeError(f"ended with {ended}, see {log}")


def _first_failure(of: pytest.Session, tests: Tests, names: Sequence[str]) -> str:
    """Run tests in this process until one fails; its name."""
    items = [tests.items[name] for name in names]
    for item, following in zip(items, [*items[1:], None], strict=True):
        of.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if tests.failed:
            with contextlib.suppress(Exception):
                of._setupstate.teardown_exact(None)
            break
    return tests.failed


def _detected(result: Result) -> str:
    detected: str = result.get("failed", f"ended with {result.get('ended')}")
    return detected


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TookTooLongError
