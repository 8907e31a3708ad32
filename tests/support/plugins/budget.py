"""The processor time of a run, printed at its end; a run of all tests but campaigns has a budget.

It also names the files that take most, each with the processes that its tests waited for.
"""

from __future__ import annotations

import resource
from collections import Counter
from collections.abc import Generator
from typing import Any, Final

import pytest

from tests.support.plugins import workers

#: Of pure and process tests together, with all workers and children [s]; 1487 to 4173 were measured, by the
#: machine, and the goal is 1200.
BUDGET_S: Final = 4200.0
#: The choice of tests that the budget is for: what CI runs.
WHOLE: Final = "not campaign"
_SPENT: Final = pytest.StashKey[list[float]]()
#: Processor time of each file [ms], of this process or of all workers.
_FILES: Final = pytest.StashKey[Counter[str]]()
#: How many files are named.
NAMED: Final = 40


def spent_s() -> float:
    """Processor time of this process and of the children that it waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def pytest_configure(config: pytest.Config) -> None:
    """Nothing is spent by workers yet."""
    config.stash[_SPENT] = []
    config.stash[_FILES] = Counter()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Add what a test and its fixtures took to its file."""
    before_s = spent_s()
    try:
        return (yield)
    finally:
        item.config.stash[_FILES][item.nodeid.partition("::")[0]] += round(1e3 * (spent_s() - before_s))


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """A worker of pytest-xdist has ended."""
    output = getattr(node, "workeroutput", {})
    node.config.stash[_SPENT].append(output.get("spent_s", 0.0))
    files_ms: Counter[str] = node.config.stash[_FILES]
    files_ms.update(output.get("files_ms", {}))


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """A worker reports; the command judges."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["spent_s"] = spent_s()
        files_ms: Counter[str] = session.config.stash[_FILES]
        output["files_ms"] = dict(files_ms)
    elif (
        _is_whole(session.config) and exitstatus == pytest.ExitCode.OK and _total_s(session.config) > BUDGET_S
    ):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """One line."""
    total_s = _total_s(config)
    budget = f", at most {BUDGET_S:.0f}" if _is_whole(config) else ""
    if _is_whole(config):
        files_ms = config.stash[_FILES]
        terminalreporter.write_line(f"files that took most, of {len(files_ms)}:")
        for file, took_ms in files_ms.most_common(NAMED):
            terminalreporter.write_line(f"{1e-3 * took_ms:8.1f} s {file}")
        terminalreporter.write_line(f"{1e-3 * sum(files_ms.values()):8.1f} s all of them")
    terminalreporter.write_line(f"processor time with workers and children: {total_s:.0f} s{budget}")
    if budget and total_s > BUDGET_S:
        terminalreporter.write_line(
            "over the budget: `pytest --durations=30` names the longest tests", red=True
        )


def _total_s(config: pytest.Config) -> float:
    # The workers are children of the command: waited for or not, they count once.
    workers_s = config.stash[_SPENT]
    own = resource.getrusage(resource.RUSAGE_SELF)
    shared_s = workers.spent_s(config)
    return own.ru_utime + own.ru_stime + shared_s + sum(workers_s) if workers_s else spent_s()


def _is_whole(config: pytest.Config) -> bool:
    named = config.args_source is pytest.Config.ArgsSource.ARGS
    return config.option.markexpr == WHOLE and not config.option.keyword and not named
