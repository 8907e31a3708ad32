"""How long a process waits for a processor: all the time beside one that computes, never while it sleeps."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext

import psutil
import pytest

from contid.control.process.isolation.process_time import ProcessTime
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

LOOK_S = 0.2


def spin() -> None:
    while True:
        pass


@contextmanager
def child_of(do: Callable[[], None]) -> Iterator[int]:
    """A child that has the least priority; its process id."""
    begun, begins = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(begins, b".")
            do()
        finally:
            os._exit(0)
    try:
        os.read(begun, 1)  # beside others that compute, a process may start late
        time.sleep(0.01)  # with the least priority it would begin what it does seconds later
        os.sched_setscheduler(child, os.SCHED_IDLE, os.sched_param(0))
        yield child
    finally:
        os.close(begun)
        os.close(begins)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def share_waited(do: Callable[[], None], looks: int = 1, busy: bool = False) -> float:
    """Share of a time that such a child waits for a processor, alone or beside one that computes."""
    with (
        one_processor() if busy else nullcontext(),
        child_of(do) as child,
        computing() if busy else nullcontext(),
        closing(ProcessTime(child)) as found,
    ):
        time.sleep(0.2)
        found.begin()
        began_s, waited_s = time.monotonic(), 0.0
        for _ in range(looks):
            time.sleep(LOOK_S / looks)
            waited_s += found.waited_s()
        return waited_s / (time.monotonic() - began_s)


@contextmanager
def one_processor() -> Iterator[None]:
    """This process and its children share one processor."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


@contextmanager
def computing() -> Iterator[None]:
    """A child that computes. It ends before a child of less priority, which could not end beside it."""
    other = os.fork()
    if not other:
        spin()
    try:
        yield
    finally:
        os.kill(other, signal.SIGKILL)
        os.waitpid(other, 0)


def sleep_then_spin() -> None:
    signal.sigwait({signal.SIGUSR1})
    spin()


def test_one_that_sleeps_does_not_wait() -> None:
    assert share_waited(lambda: time.sleep(100.0)) < 0.2


@pytest.mark.parametrize("looks", [1, 4])
def test_one_beside_others_that_compute_waits(looks: int) -> None:
    """A normal process takes the processor from one of the least priority."""
    assert 0.5 < share_waited(spin, looks=looks, busy=True) < 1.01


def test_a_sleep_before_a_look_is_no_waiting() -> None:
    """The look finds it waiting for a processor, but until the signal it slept."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
    try:
        with one_processor(), child_of(sleep_then_spin) as child, closing(ProcessTime(child)) as found:
            until(lambda: psutil.Process(child).status() == psutil.STATUS_SLEEPING, "it sleeps")
            with computing():
                found.begin()
                time.sleep(LOOK_S)
                slept_until_s = time.monotonic()
                os.kill(child, signal.SIGUSR1)
                time.sleep(0.03)
                assert found.waited_s() < time.monotonic() - slept_until_s + 0.1 * LOOK_S
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def test_none_is_no_process() -> None:
    none = ProcessTime(0)
    none.begin()
    assert none.waited_s() == 0.0
