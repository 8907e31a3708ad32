"""How long a process waits for a processor: all the time beside one that computes, never while it sleeps."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from contid.control.process.isolation.process_time import ProcessTime

pytestmark = [pytest.mark.process, pytest.mark.realtime]

LOOK_S = 0.2


def spin() -> None:
    while True:
        pass


def share_waited(do: Callable[[], None], before_s: float = 0.2, looks: int = 1) -> float:
    """Share of a time that a child, which has the least priority, waits for a processor."""
    begun, begins = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
            os.write(begins, b".")
            do()
        finally:
            os._exit(0)
    found = ProcessTime(child)
    try:
        os.read(begun, 1)  # beside others that compute, a process may start late
        time.sleep(before_s)
        found.begin()
        began_s, waited_s = time.monotonic(), 0.0
        for _ in range(looks):
            time.sleep(LOOK_S / looks)
            waited_s += found.waited_s()
        return waited_s / (time.monotonic() - began_s)
    finally:
        found.close()
        os.close(begun)
        os.close(begins)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


@contextmanager
def busy_processor() -> Iterator[None]:
    """This process and its children share one processor with one that computes."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    other = os.fork()
    if not other:
        spin()
    try:
        yield
    finally:
        os.kill(other, signal.SIGKILL)
        os.waitpid(other, 0)
        os.sched_setaffinity(0, before)


def sleep_then_spin() -> None:
    time.sleep(0.17)
    spin()


def test_one_that_sleeps_does_not_wait() -> None:
    assert share_waited(lambda: time.sleep(100.0)) < 0.2


@pytest.mark.parametrize("looks", [1, 4])
def test_one_beside_others_that_compute_waits(looks: int) -> None:
    """A normal process takes the processor from one of the least priority."""
    with busy_processor():
        share = share_waited(spin, looks=looks)
    assert 0.5 < share < 1.01


def test_a_sleep_before_a_look_is_no_waiting() -> None:
    """The look finds it waiting for a processor, but most of the time it slept."""
    with busy_processor():
        assert share_waited(sleep_then_spin, before_s=0.0) < 0.5


def test_none_is_no_process() -> None:
    none = ProcessTime(0)
    none.begin()
    assert none.waited_s() == 0.0
