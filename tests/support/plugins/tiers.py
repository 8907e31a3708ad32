"""Three tiers: what a test without a mark may do, which tests run, and what the whole suite may cost.

A test without a mark is **pure**: it starts no process, does not sleep, takes at most `PURE_S`. Those with
the marks `process`, `slow`, `campaign` and `realtime` may. ``pytest`` without a path runs the pure tests and
judges what they do; with a path it runs everything there. CI runs all but campaigns.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pytest

#: Marks of tests that are not pure.
MARKS: Final = ("process", "slow", "campaign", "realtime")
#: How a file begins whose tests are all campaigns.
CAMPAIGN: Final = re.compile(r"^pytestmark = .*pytest\.mark\.campaign\b", re.MULTILINE)
#: A campaign without a time of its own fails after this [s], which a busy machine needs for some.
CAMPAIGN_TIMEOUT_S: Final = 3600
#: Processor time of a pure test with its fixtures [s].
PURE_S: Final = 2.0
#: Most that a pure test may sleep, all calls together [s].
SLEEP_S: Final = 0.1
#: Events of the interpreter (sys.addaudithook) that begin a process.
STARTS: Final = ("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system", "os.spawn")
#: A run of pure tests only, and one that judges what pure tests do: from the command, for its workers.
_ONLY_PURE: Final = pytest.StashKey[bool]()
_JUDGED: Final = pytest.StashKey[bool]()


@dataclass
class Seen:
    """What a test did."""

    began_s: float = field(default_factory=time.process_time)
    started: str | None = None
    slept_s: float = 0.0


_SEEN: Final = pytest.StashKey[Seen]()
_current: Seen | None = None


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if _current is None:
        return
    if event in STARTS and _current.started is None:
        _current.started = f"{event} {arguments[1] if len(arguments) > 1 else ''}"[:200]
    elif event == "time.sleep":
        _current.slept_s += float(arguments[0])


sys.addaudithook(_audit)


#: Workers of a run of pure tests.
WORKERS: Final = 2


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Without a path, ``-m`` and ``-k``, two workers share the pure tests; workers share them by files."""
    if hasattr(config, "workerinput"):
        return
    option = config.option
    chosen = config.args_source is pytest.Config.ArgsSource.ARGS or option.markexpr or option.keyword
    if not chosen and not option.collectonly and not option.usepdb and option.numprocesses is None:
        option.numprocesses = WORKERS
    # A worker gets whole files: their daemons, browsers and fits are made once, not in every worker.
    if option.numprocesses and option.dist == "no":
        option.dist = "loadfile"


def pytest_configure(config: pytest.Config) -> None:
    """Without a path and without ``-m``, only pure tests run."""
    worker = getattr(config, "workerinput", None)
    named = config.args_source is pytest.Config.ArgsSource.ARGS
    config.stash[_ONLY_PURE] = (
        not (named or config.option.markexpr) if worker is None else worker["only_pure"]
    )
    config.stash[_JUDGED] = not named if worker is None else worker["judged"]


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: Any) -> None:
    """Workers of pytest-xdist get the choice of tests."""
    node.workerinput["only_pure"] = node.config.stash[_ONLY_PURE]
    node.workerinput["judged"] = node.config.stash[_JUDGED]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Files of campaigns only are not imported where campaigns do not run: every worker imports all."""
    others = config.stash[_ONLY_PURE] or config.option.markexpr == "not campaign"
    if others and collection_path.match("test_*.py") and CAMPAIGN.search(collection_path.read_text()):
        return True
    return None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Choose the tests of a run without arguments; campaigns run what users run, and longer."""
    for item in items:
        if item.get_closest_marker("campaign"):
            item.add_marker(pytest.mark.true_process)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(CAMPAIGN_TIMEOUT_S))
    if config.stash[_ONLY_PURE]:
        others = [item for item in items if not _is_pure(item)]
        config.hook.pytest_deselected(items=others)
        items[:] = [item for item in items if _is_pure(item)]


def _is_pure(item: pytest.Item) -> bool:
    return not any(item.get_closest_marker(mark) for mark in MARKS)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Watch a test with its fixtures."""
    global _current
    item.stash[_SEEN] = _current = Seen()
    try:
        return (yield)
    finally:
        _current = None


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    """A pure test that did more than it may fails when it has been torn down."""
    report = yield
    if item.config.stash[_JUDGED] and report.when == "teardown" and report.passed and _is_pure(item):
        seen = item.stash[_SEEN]
        # Beside the processes of a whole run, processor time is up to three times as long.
        share = 1.0 if item.config.stash[_ONLY_PURE] else 1.0 / 3.0
        found = faults(seen, share * (time.process_time() - seen.began_s))
        if found:
            report.outcome = "failed"
            report.longrepr = f"{item.nodeid} is not pure (tests/README.md): it {'; it '.join(found)}"
    return report


def faults(seen: Seen, took_s: float) -> list[str]:
    """What a test did that a pure one must not do."""
    found = []
    if seen.started is not None:
        found.append(f"starts a process ({seen.started}): mark it `process`")
    elif seen.slept_s > SLEEP_S:
        found.append(
            f"sleeps {seen.slept_s:.2f} s, at most {SLEEP_S:g}: use a virtual clock, or mark it `process`"
        )
    if took_s > PURE_S:
        found.append(f"takes {took_s:.1f} s of processor time, at most {PURE_S:g}: mark it `slow`")
    return found
