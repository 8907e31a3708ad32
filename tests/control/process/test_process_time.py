"""How long a process waits for a processor: all the time beside one that computes, never while it sleeps."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from contid.control.process.isolation.process_time import ProcessTime

pytestmark = [pytest.mark.process, pytest.mark.realtime]

LOOK_S = 0.2


def spin() -> None:
    while True:
        pass


def share_waited(do: Callable[[], None]) -> float:
    """Share of a time that a child, which has the least priority, waits for a processor."""
    begun, begins = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(begins, b".")
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
            do()
        finally:
            os._exit(0)
    found = ProcessTime(child)
    try:
        os.read(begun, 1)  # beside others that compute, a process may start late
        time.sleep(0.2)
        waiting = found.waiting()
        began_s = time.monotonic()
        time.sleep(LOOK_S)
        passed_s = time.monotonic() - began_s
        return waiting(passed_s) / passed_s
    finally:
        found.close()
        os.close(begun)
        os.close(begins)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def test_one_that_sleeps_does_not_wait() -> None:
    assert share_waited(lambda: time.sleep(100.0)) < 0.2


def test_one_beside_others_that_compute_waits() -> None:
    """They share one processor, which a normal process takes from one of the least priority."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    other = os.fork()
    if not other:
        spin()
    try:
        assert share_waited(spin) > 0.5
    finally:
        os.kill(other, signal.SIGKILL)
        os.waitpid(other, 0)
        os.sched_setaffinity(0, before)


def test_none_is_no_process() -> None:
    assert ProcessTime(0).waiting()(1.0) == 0.0
