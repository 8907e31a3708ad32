"""Messages arrive whole, in order, and the end of the pipe is noticed."""

from __future__ import annotations

import os

import pytest

from contid.control.messages import PART, End, Estop, Goto, Hold, Inbox, Rows, frame, parts
from contid.control.statistics import Lateness, RobotTally
from contid.targets import Target


def test_messages_come_whole_however_the_bytes_arrive() -> None:
    read, write = os.pipe()
    inbox = Inbox(read)
    sent = [Hold(("a",)), Rows({"a": Target(tip_m=(1.0, 2.0, 0.1)), "b": None}), End()]
    got: list[object] = []
    for byte in b"".join(map(frame, sent)):
        os.write(write, bytes([byte]))
        got += inbox.poll()
    assert got == sent
    assert inbox.poll() == []
    assert not inbox.closed
    os.close(write)
    inbox.poll()
    assert inbox.closed
    os.close(read)


def test_an_order_overtakes_the_rest_of_a_long_message() -> None:
    read, write = os.pipe()
    inbox = Inbox(read)
    long = Rows({f"r{i}": Target(tip_m=(float(i), 0.5, 0.25)) for i in range(2000)})
    first, *others = parts(long)
    assert others
    assert len(first) < 2 * PART
    for piece in (first, frame(Estop())):
        os.write(write, piece)
    assert inbox.poll() == [Estop()]
    got: list[object] = []
    for piece in others:
        os.write(write, piece)
        got += inbox.poll()
    assert got == [long]
    os.close(write)
    os.close(read)


def test_wait_takes_one_and_leaves_the_rest() -> None:
    read, write = os.pipe()
    inbox = Inbox(read)
    goto = Goto("a", Target(actuation=(0.1, 0.2)))
    os.write(write, frame(goto) + frame(End()))
    assert inbox.wait() == goto
    assert inbox.poll() == [End()]
    os.close(write)
    with pytest.raises(EOFError):
        inbox.wait()
    os.close(read)


def test_the_histogram_keeps_three_digits() -> None:
    lateness = Lateness()
    for us in range(1, 10_001):
        lateness.add((us + 0.5) * 1e-6)
    figures = lateness.as_dict()
    assert figures["p50_us"] == pytest.approx(5000, rel=0.01)
    assert figures["p99_us"] == pytest.approx(9900, rel=0.01)
    assert figures["max_us"] == pytest.approx(10_000.5)
    assert len(lateness.counts) < 2000


def test_the_tally_counts_what_was_followed() -> None:
    tally = RobotTally()
    tally.add(3e-6, True)
    tally.add(4e-6, False)
    told = tally.as_dict()
    assert told["tip_error_max_mm"] == pytest.approx(4e-3)
    assert told["tip_error_rms_mm"] == pytest.approx((12.5e-12) ** 0.5 * 1e3)
    assert (told["ticks_followed"], told["ticks_unreachable"]) == (2, 1)
