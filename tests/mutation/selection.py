"""Selects the tests of a mutant: those that execute its line, or that use what its line defines.

A line inside a function is executed by tests. A constant, a table or a field is evaluated once, at import:
its tests are those that execute a line with its name, or with the name of something that is made of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from tests.mutation.executed import Executed
from tests.mutation.mutants import Mutant
from tests.mutation.names import names_of


@dataclass(frozen=True)
class Selected:
    """The tests of one mutant.

    Attributes:
        tests: node ids, the fastest first.
        cold: the change takes effect at import.
    """

    tests: tuple[str, ...]
    cold: bool


class Selection:
    """The tests of every mutant.

    Args:
        sources: text of every module.
        executed: which tests execute which lines.
        budget_s: processor time of the tests of a mutant.
    """

    def __init__(self, sources: Mapping[str, str], executed: Executed, budget_s: float) -> None:
        self._names = {module: names_of(text) for module, text in sources.items()}
        self._executed = executed
        self._budget_s = budget_s

    def of(self, mutant: Mutant) -> Selected:
        """The tests of a mutant."""
        names = self._names[mutant.module]
        if mutant.line in names.inside:
            lines = self._statement(mutant.module, mutant.line)
            tests = self._of_lines(mutant.module, lines)
            cold = bool(self._executed.collected.get(mutant.module, frozenset()).intersection(lines))
            if not tests:  # perhaps a function that computes a constant
                cold, tests = True, self._of_names(names.made[names.owner[mutant.line]])
        else:
            cold, tests = True, self._of_names(names.defined[mutant.line])
            if not tests:  # perhaps a constant that is used elsewhere only
                tests = self._of_lines(mutant.module, self._executed.lines.get(mutant.module, ()))
        chosen: list[str] = []
        spent_s = 0.0
        for name in self._ordered(tests):
            spent_s += self._executed.times_s[name]
            if chosen and spent_s > self._budget_s:
                break
            chosen.append(name)
        return Selected(tuple(chosen), cold)

    def _statement(self, module: str, line: int) -> range:
        first, last = self._names[module].inside.get(line, (line, line))
        return range(first, last + 1)

    def _of_lines(self, module: str, lines: Iterable[int]) -> set[str]:
        by_line = self._executed.lines.get(module, {})
        return {test for line in lines for test in by_line.get(line, ())}

    def _of_names(self, names: set[str]) -> set[str]:
        """Tests of lines in which a name occurs, or the name of something that is made of it."""
        known, fresh = set[str](), set(names)
        while fresh:
            known |= fresh
            fresh = {
                new for each in self._names.values() for name in fresh for new in each.made[name]
            } - known
        return {
            test
            for module, each in self._names.items()
            for name in known
            for line in each.used[name]
            for test in self._of_lines(module, self._statement(module, line))
        }

    def _ordered(self, tests: set[str]) -> list[str]:
        """The fastest first; those of a file that share a fixture together, when it is their turn."""
        times_s, shared = self._executed.times_s, self._executed.shared
        together: dict[str, float] = {}
        for name in tests & shared:
            file = name.split("::")[0]
            together[file] = together.get(file, 0.0) + times_s[name]

        def key(name: str) -> tuple[float, str, float, str]:
            file = name.split("::")[0]
            return (together[file] if name in shared else times_s[name], file, times_s[name], name)

        return sorted(tests, key=key)
