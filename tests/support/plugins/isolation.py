"""Nothing may be left behind: a test that leaves a thread, a child process, a file or a task fails.

The processes that it left are ended, so that no other test fails for it.

pytest-asyncio runs each test in a loop of its own, so tasks are checked before that loop closes.
"""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import threading
import time
import warnings
from collections.abc import AsyncIterator, Generator, Iterator
from contextlib import suppress
from multiprocessing import resource_tracker
from pathlib import Path

import pytest
from hypothesis import settings

from tests.support.plugins import forked

# Time is measured in benchmarks/, on a machine that may be busy.
# Examples are the same at every run: the commit alone decides whether it passes. Others are drawn with
# ``--hypothesis-profile=random``.
settings.register_profile("contid", deadline=None, derandomize=True, max_examples=60)
settings.register_profile("random", deadline=None)
settings.load_profile("contid")
# `nohup` and a shell's `&` ignore signals in what they start: in the tests, and so in the daemons of tests.
for number, action in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, action)
#: Collections left that give no warning about resources.
_quiet_looks = 0
# Threads that belong to the test runner itself, not to the code under test.
RUNNER_THREADS = ("pytest_timeout", "execnet", "asyncio_", "ThreadPoolExecutor-pytest")


def _descriptors() -> dict[int, str]:
    found = {}
    for name in os.listdir("/proc/self/fd"):  # noqa: PTH208 -- at every test
        try:
            found[int(name)] = os.readlink(f"/proc/self/fd/{name}")  # noqa: PTH115
        except OSError:
            continue
    return found


def _children() -> set[int]:
    """Children of this process that a test may have started, also dead ones that were not waited for."""
    return forked.children() - {forked.pid()} - forked.adopted()


def _command_line(pid: int) -> str:
    try:
        line = Path(f"/proc/{pid}/cmdline").read_text(errors="replace")
    except OSError:  # gone meanwhile
        line = ""
    return " ".join(line.split("\0")[:4]) or "without a command line"


def _left_behind(threads: set[int | None], children: set[int], descriptors: dict[int, str]) -> list[str]:
    now_open = _descriptors()
    return [
        *(
            f"thread {t.name}"
            for t in threading.enumerate()
            if t.ident not in threads and not t.name.startswith(RUNNER_THREADS)
        ),
        *(
            f"child process {pid} {line}"
            for pid in _children() - children
            if "resource_tracker" not in (line := _command_line(pid))
        ),
        *(
            f"file descriptor {fd} ({what})"
            for fd, what in now_open.items()
            if descriptors.get(fd) != what and "/proc/" not in what and fd not in forked.descriptors()
        ),
    ]


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays: looking for garbage meanwhile was a seventh of the time that it takes."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Modules, fixtures and items stay: nothing that is frozen is looked at again."""
    gc.collect()
    gc.freeze()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """A try that failed leaves what its traceback kept: no warning about that is of the tests that follow."""
    global _quiet_looks
    if report.outcome in ("failed", "rerun"):
        _quiet_looks = 2  # the interpreter keeps the newest traceback until the next test


def _collect() -> None:
    """Collect garbage; what a failed try left is closed without a warning."""
    global _quiet_looks
    with warnings.catch_warnings():
        if _quiet_looks:
            _quiet_looks -= 1
            warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()


@pytest.fixture(scope="module", autouse=True)
def garbage_of_other_modules() -> None:
    """Collect once per module what outlived the tests that made it; the rest is not looked at again."""
    _collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def nothing_left_behind(garbage_of_other_modules: None) -> Iterator[None]:
    """Fail a test that leaves threads, child processes or file descriptors."""
    if _quiet_looks:
        _collect()
    threads = {t.ident for t in threading.enumerate()}
    # multiprocessing starts its resource tracker once per interpreter and keeps its pipe.
    resource_tracker.ensure_running()
    children = _children()
    descriptors = _descriptors()
    yield
    # What only a cycle keeps is found here and collected; threads and sockets may need a moment to end after
    # their owner closed them.
    deadline = time.monotonic() + 2.0
    while (rest := _left_behind(threads, children, descriptors)) and time.monotonic() < deadline:
        gc.collect()
        time.sleep(0.02)
    # A process that is left shares processors and open files with every test that follows.
    for pid in _children() - children if rest else ():
        if "resource_tracker" not in _command_line(pid):
            with suppress(ProcessLookupError, ChildProcessError):
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
    assert not rest, f"left behind: {rest}"


@pytest.fixture
async def no_tasks_left() -> AsyncIterator[None]:
    """Fail an asyncio test that leaves tasks running."""
    before = asyncio.all_tasks()
    yield
    left = {task for task in asyncio.all_tasks() - before - {asyncio.current_task()} if not task.done()}
    assert not left, f"tasks left: {left}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every coroutine test gets the task check."""
    for item in items:
        if isinstance(item, pytest.Function) and asyncio.iscoroutinefunction(item.function):
            item.fixturenames.append("no_tasks_left")
