"""Which lines of the tick every test executes, and its processor time: one run of all under coverage."""

from __future__ import annotations

import importlib
import json
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import coverage
import pytest

from tests.mutation.forked import Forked, Result
from tests.mutation.mutants import (
    MUTATED,
    ROOT,
    fingerprint,
    fingerprint_of_the_rest,
    is_test,
    modules,
    tracked,
)
from tests.mutation.trial import Tests, session

#: Tests of the tick that start no processes.
SUITES: Final = (
    *(
        "tests/control/tick",
        "tests/control/engine",
        "tests/golden",
        "tests/sense",
        "extras/fit/tests",
        "tests/clearance",
    ),
    *("tests/control/daemon/test_stretch.py", "tests/api/test_sim.py"),
)


@dataclass(frozen=True)
class Executed:
    """What all tests execute.

    Attributes:
        times_s: processor time of every test.
        lines: by module and line, the tests that execute it.
        collected: by module, lines that are executed when a file of tests is imported.
        shared: tests with fixtures that several tests share; these are run file by file.
    """

    times_s: dict[str, float]
    lines: dict[str, dict[int, set[str]]]
    collected: dict[str, set[int]]
    shared: set[str]

    @classmethod
    def of(cls, measured: Iterable[Result]) -> Executed:
        """From the results of all files of tests."""
        lines: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        whole = cls({}, lines, defaultdict(set), set())
        for each in measured:
            names = list(each["times_s"])
            whole.times_s.update(each["times_s"])
            whole.shared.update(each["shared"])
            for module, collected in each["collected"].items():
                whole.collected[module].update(collected)
            for module, by_line in each["lines"].items():
                for line, tests in by_line.items():
                    lines[module][int(line)].update(names[i] for i in tests)
        return whole


class _Contexts:
    """Plugin of pytest that gives coverage its contexts.

    They are every test, every fixture that several tests share, and the import of every file of tests.
    """

    def __init__(self) -> None:
        folder = str(ROOT / MUTATED)
        self._coverage = coverage.Coverage(data_file=None, source=[folder], config_file=False)
        self._times_s: dict[str, float] = {}
        #: By context, the tests that it is part of.
        self._parts: dict[str, list[str]] = defaultdict(list)
        self._shared: set[str] = set()
        self._item = ""

    def pytest_configure(self) -> None:
        """What the tick executes at its import belongs to no context."""
        self._coverage.start()
        for module in modules():
            importlib.import_module(".".join((MUTATED / module).with_suffix("").parts))

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Iterator[Any]:
        if isinstance(collector, pytest.Module):
            self._coverage.switch_context(f"import {collector.nodeid}")
        try:
            return (yield)
        finally:
            self._coverage.switch_context("")

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._item = item.nodeid
        self._parts[item.nodeid].append(item.nodeid)
        self._parts[f"import {item.nodeid.split('::')[0]}"].append(item.nodeid)
        fixtures = item._fixtureinfo.name2fixturedefs if isinstance(item, pytest.Function) else {}
        for name in getattr(item, "fixturenames", ()):
            for fixture in fixtures.get(name, ())[-1:]:
                if fixture.scope != "function":
                    self._parts[_context(fixture)].append(item.nodeid)
                    if fixture.baseid not in ("", "tests"):
                        self._shared.add(item.nodeid)
        begin_s = time.process_time()
        self._coverage.switch_context(self._item)
        try:
            return (yield)
        finally:
            self._coverage.switch_context("")
            self._times_s[item.nodeid] = time.process_time() - begin_s

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[Any]:
        if fixturedef.scope != "function":
            self._coverage.switch_context(_context(fixturedef))
        try:
            return (yield)
        finally:
            self._coverage.switch_context(self._item)

    def results(self) -> dict[str, Result]:
        """By file of tests, what `Executed.of` takes."""
        self._coverage.stop()
        data = self._coverage.get_data()
        found: dict[str, Result] = defaultdict(_empty)
        index: dict[str, int] = {}
        for name, time_s in self._times_s.items():
            file = found[name.split("::")[0]]
            index[name] = len(file["times_s"])
            file["times_s"][name] = time_s
            file["shared"] += [name] if name in self._shared else []
        for path in data.measured_files():
            module = Path(path).relative_to(ROOT / MUTATED).as_posix()
            for line, contexts in data.contexts_by_lineno(path).items():
                for name in sorted({test for each in contexts for test in self._parts.get(each, ())}):
                    by_line = found[name.split("::")[0]]["lines"].setdefault(module, {})
                    by_line.setdefault(line, []).append(index[name])
                for file in {each.removeprefix("import ") for each in contexts} & found.keys():
                    found[file]["collected"].setdefault(module, []).append(line)
        return found


def _empty() -> Result:
    return {"times_s": {}, "lines": {}, "collected": {}, "shared": []}


def _context(fixture: Any) -> str:
    return f"fixture {fixture.argname} of {fixture.baseid}"


def measured(folder: Path) -> Executed:
    """What the suites execute; files of tests that have changed since they were measured run again.

    Raises:
        RuntimeError: a test fails without a mutant.
    """
    folder.mkdir(parents=True, exist_ok=True)
    base = fingerprint_of_the_rest()
    tests = [name for name in tracked() if is_test(name) and name.startswith(SUITES)]
    kept = {name: folder / f"{base}-{fingerprint([name])}.json" for name in tests}
    if missing := [name for name, path in kept.items() if not path.exists()]:
        for name, result in _measure(missing, str(folder / "log")).items():
            kept[name].write_text(json.dumps(result), encoding="utf-8")
    return Executed.of(
        json.loads(path.read_text(encoding="utf-8")) for path in kept.values() if path.exists()
    )


def _measure(files: Sequence[str], log: str) -> dict[str, Result]:
    def suites() -> Result:
        tests, contexts = Tests({}), _Contexts()
        code = session(files, [tests, contexts])
        return {"code": code, "failed": tests.failed, "found": contexts.results()}

    result = Forked(suites, log=log).wait()
    if result.get("code") != 0:
        raise RuntimeError(f"without a mutant: {result.get('failed', result)} fails, see {log}")
    found: dict[str, Result] = result["found"]
    return found
