"""Which lines of the tick every test executes, and its processor time: one run of the suites under coverage."""

from __future__ import annotations

import importlib
import json
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import coverage
import pytest

from tests.mutation.forked import Forked, Result
from tests.mutation.mutants import MUTATED, ROOT, modules
from tests.mutation.trial import Tests, session

#: Tests of the tick that start no processes.
SUITES: Final = (
    *("tests/control/tick", "tests/control/engine", "tests/golden", "tests/sense", "tests/clearance"),
    *("tests/control/daemon/test_stretch.py", "tests/session/test_replay.py", "tests/api/test_sim.py"),
)


@dataclass(frozen=True)
class Executed:
    """The result of the run.

    Attributes:
        times_s: processor time of every test.
        lines: by module and line, the tests that execute it.
        collected: by module, lines that are executed when a file of tests is imported.
        shared: tests with fixtures that several tests share; these are run file by file.
    """

    times_s: dict[str, float]
    lines: dict[str, dict[int, frozenset[str]]]
    collected: dict[str, frozenset[int]]
    shared: frozenset[str]

    @classmethod
    def read(cls, path: Path) -> Executed:
        """From a file that `measure` wrote."""
        found = json.loads(path.read_text(encoding="utf-8"))
        names = list(found["times_s"])
        lines = {
            module: {int(line): frozenset(names[i] for i in tests) for line, tests in by_line.items()}
            for module, by_line in found["lines"].items()
        }
        collected = {module: frozenset(each) for module, each in found["collected"].items()}
        return cls(found["times_s"], lines, collected, frozenset(found["shared"]))


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

    def result(self) -> Result:
        """What `Executed.read` reads."""
        self._coverage.stop()
        data = self._coverage.get_data()
        index = {name: i for i, name in enumerate(self._times_s)}
        tests = {name: [index[item] for item in items] for name, items in self._parts.items()}
        lines: dict[str, dict[int, list[int]]] = defaultdict(dict)
        collected: dict[str, list[int]] = defaultdict(list)
        for path in data.measured_files():
            module = Path(path).relative_to(ROOT / MUTATED).as_posix()
            for line, contexts in data.contexts_by_lineno(path).items():
                found = {i for context in contexts for i in tests.get(context, ())}
                if found:
                    lines[module][line] = sorted(found)
                if any(context.startswith("import ") for context in contexts):
                    collected[module].append(line)
        shared = sorted(self._shared)
        return {"times_s": self._times_s, "lines": lines, "collected": collected, "shared": shared}


def _context(fixture: Any) -> str:
    return f"fixture {fixture.argname} of {fixture.baseid}"


def measure(path: Path) -> None:
    """Run all suites once and write what they execute.

    Raises:
        RuntimeError: a test fails without a mutant.
    """
    log = str(path.with_suffix(".log"))

    def suites() -> Result:
        tests, contexts = Tests({}), _Contexts()
        code = session(SUITES, [tests, contexts])
        return {"code": code, "failed": tests.failed, **contexts.result()}

    result = Forked(suites, log=log).wait()
    if result.get("code") != 0:
        raise RuntimeError(f"without a mutant: {result.get('failed', result)} fails, see {log}")
    path.write_text(json.dumps(result), encoding="utf-8")
