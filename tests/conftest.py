"""Fixtures for every test: nothing may be left behind.

A test that leaves a thread, a child process, an open file descriptor or an asyncio task fails, whatever it
asserted. pytest-asyncio runs each test in a loop of its own, so tasks are checked before that loop closes.
"""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Iterator
from multiprocessing import resource_tracker
from pathlib import Path

import psutil
import pytest
from hypothesis import settings

ROOT = Path(__file__).parent.parent
# Time is measured in benchmarks/, on a machine that may be busy.
# Examples are the same at every run: the commit alone decides whether it passes. Others are drawn with
# ``--hypothesis-profile=random``.
settings.register_profile("contid", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("contid")
# `nohup` and a shell's `&` ignore signals in what they start: in the tests, and so in the daemons of tests.
for number, action in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, action)
# Threads that belong to the test runner itself, not to the code under test.
RUNNER_THREADS = ("pytest_timeout", "execnet", "asyncio_", "ThreadPoolExecutor-pytest")


def _descriptors() -> dict[int, str]:
    found = {}
    for entry in Path("/proc/self/fd").iterdir():
        try:
            found[int(entry.name)] = str(entry.readlink())
        except OSError:
            continue
    return found


def _command_line(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline()[:4])
    except psutil.NoSuchProcess:  # a zombie, or gone meanwhile
        return "without a command line"


def _left_behind(threads: set[int | None], children: set[int], descriptors: dict[int, str]) -> list[str]:
    now_open = _descriptors()
    return [
        *(
            f"thread {t.name}"
            for t in threading.enumerate()
            if t.ident not in threads and not t.name.startswith(RUNNER_THREADS)
        ),
        *(
            f"child process {p.pid} {line}"
            for p in psutil.Process().children()
            if p.pid not in children and "resource_tracker" not in (line := _command_line(p))
        ),
        *(
            f"file descriptor {fd} ({what})"
            for fd, what in now_open.items()
            if descriptors.get(fd) != what and "/proc/" not in what
        ),
    ]


@pytest.fixture(scope="module", autouse=True)
def garbage_of_other_modules() -> None:
    """Collect once per module what outlived the tests that made it."""
    gc.unfreeze()
    gc.collect()


@pytest.fixture(autouse=True)
def nothing_left_behind(garbage_of_other_modules: None) -> Iterator[None]:
    """Fail a test that leaves threads, child processes or file descriptors."""
    threads = {t.ident for t in threading.enumerate()}
    # multiprocessing starts its resource tracker once per interpreter and keeps its pipe.
    resource_tracker.ensure_running()
    children = {p.pid for p in psutil.Process().children()}
    descriptors = _descriptors()
    # Objects made before this test are frozen, so that collecting after it covers its own objects only.
    gc.freeze()
    yield
    gc.collect()
    # Threads and sockets may need a moment to end after their owner closed them.
    deadline = time.monotonic() + 2.0
    while (rest := _left_behind(threads, children, descriptors)) and time.monotonic() < deadline:
        time.sleep(0.02)
        gc.collect()
    assert not rest, f"left behind: {rest}"


@pytest.fixture
async def no_tasks_left() -> AsyncIterator[None]:
    """Fail an asyncio test that leaves tasks running."""
    before = asyncio.all_tasks()
    yield
    left = {task for task in asyncio.all_tasks() - before - {asyncio.current_task()} if not task.done()}
    assert not left, f"tasks left: {left}"


# A virtual machine that stands still for a tenth of a second looks exactly like a dead bus, so `realtime`
# tests may be tried three times. `pytest_sessionfinish` limits how many need it.
# A stall often lasts longer than the start of the next try, hence the delay.
RERUNS = 3
RERUN_DELAY_S = 3


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every coroutine test gets the task check, every `realtime` test its further tries.

    The hooks of this file are also those of `extras/conftest.py`: called twice, they do their work once.
    """
    for item in items:
        if item.get_closest_marker("realtime") and not item.get_closest_marker("flaky"):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=RERUN_DELAY_S))
        if (
            isinstance(item, pytest.Function)
            and asyncio.iscoroutinefunction(item.function)
            and "no_tasks_left" not in item.fixturenames
        ):
            item.fixturenames.append("no_tasks_left")


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Fail a run in which more than CONTID_MAX_RERUN_RATE of the tests had to be tried again (CI: 0.01)."""
    limit = os.environ.get("CONTID_MAX_RERUN_RATE")
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if limit is None or reporter is None or session.exitstatus != pytest.ExitCode.OK:
        return
    again = {report.nodeid for report in reporter.stats.get("rerun", [])}
    run = len(reporter.stats.get("passed", []))
    if len(again) > float(limit) * run:
        reporter.write_line(f"{len(again)} of {run} tests were tried again, allowed {float(limit):.1%}:")
        for test in sorted(again):
            reporter.write_line(f"  {test}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.fixture(scope="session", autouse=True)
def own_sockets() -> Iterator[None]:
    """Daemons of this run put their sockets where no other run looks."""
    # Short: the path of a socket has 107 bytes.
    with tempfile.TemporaryDirectory(prefix="contid-") as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", folder)
        yield


@pytest.fixture(scope="session")
def configs() -> Path:
    """Folder of the robot files that ship with contid."""
    return ROOT / "configs"
