"""The live stream on stdin: bursts are followed whole; a flood is skipped to its newest row."""

from __future__ import annotations

import asyncio
import itertools
import logging
import os
import threading

import pytest

from contid.control.daemon.inputs import Stream
from contid.control.daemon.row_stream import BUDGET_S, LiveRowReader, StreamFollower
from contid.control.engine.messages import Message, Rows
from contid.robot_file.load import parse_robot_file
from contid.trajectory.rows import RowReader
from contid.units import MAX_LINE
from tests.support.fingers import fingers

#: Rows of the flood; the pipe takes about 5000 at a time.
ROWS = 20_000


def follow(text: str, row_s: float, pending: tuple[tuple[int, str], ...] = ()) -> tuple[list[float], int]:
    """Follow a text from a pipe, with a clock that advances per look: x of the sent rows [mm], loop turns."""
    robots = parse_robot_file(fingers(1), "fingers.yaml").driven
    inside, outside = os.pipe()
    stream = Stream(RowReader("x_mm,y_mm", "stdin", robots), "stdin", inside, pending, 1 + len(pending))
    sent: list[float] = []
    beats = 0

    def send(message: Message) -> None:
        assert isinstance(message, Rows)
        target = message.targets["f0"]
        assert target is None or target.tip_m is not None
        sent.append(float("nan") if target is None or target.tip_m is None else target.tip_m[0] * 1e3)

    async def beat() -> None:
        nonlocal beats
        while True:
            beats += 1
            await asyncio.sleep(0)

    async def run() -> None:
        clock = itertools.count()
        beating = asyncio.create_task(beat())
        reader = LiveRowReader(stream, None)

        async def read(line: str, number: int) -> Message | None:
            return reader.row(line, number)

        follower = StreamFollower(stream, read, send, lambda: next(clock) * row_s)
        await follower.follow()
        beating.cancel()

    def write() -> None:
        with os.fdopen(outside, "w") as pipe:
            pipe.write(text)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        asyncio.run(run())
    finally:
        os.close(inside)
        writer.join()
    return sent, beats


def test_a_burst_is_followed_row_by_row() -> None:
    sent, _ = follow("".join(f"{x},75\n# comment\n\n" for x in range(30, 60)), BUDGET_S / 1000)
    assert sent == pytest.approx(list(range(30, 60)))


def test_a_producer_without_a_pace_is_skipped_to_its_newest_row(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        sent, beats = follow("".join(f"{i / 1000},75\n" for i in range(ROWS)) + "# end\n", BUDGET_S / 4)
    assert sent == sorted(sent)
    assert sent[-1] == pytest.approx((ROWS - 1) / 1000)
    assert len(sent) < ROWS / 100
    assert beats > len(sent) / 6, "the event loop ran between the turns"
    assert caplog.text.count("faster than they can be checked") == 1


@pytest.mark.parametrize("row_s", [BUDGET_S / 1000, BUDGET_S * 2])
def test_a_row_that_is_cut_off_is_not_followed(row_s: float, caplog: pytest.LogCaptureFixture) -> None:
    sent, _ = follow("40,75\n41,75\n42,7", row_s)
    assert sent[-1] == pytest.approx(41.0)
    assert "cut off" in caplog.text


def test_a_wrong_row_holds(caplog: pytest.LogCaptureFixture) -> None:
    sent, _ = follow("40,75\n41\n", BUDGET_S / 1000)
    assert sent[0] == pytest.approx(40.0)
    assert len(sent) == 2
    assert sent[1] != sent[1]
    assert "holding" in caplog.text


def test_the_rest_of_a_line_that_is_too_long_is_no_row(caplog: pytest.LogCaptureFixture) -> None:
    """It came in as a line of its own, and its end was followed."""
    sent, _ = follow("40,75\n" + "1" * (3 * MAX_LINE) + "\n41,75\n" + ",50,75" * 60_000 + "\n42\n", 0.0)
    numbers = [float("nan") if x != x else round(x) for x in sent]
    assert [x for x in numbers if x == x] == [40, 41], numbers
    assert "stdin:5:1: " in caplog.text, "lines keep their numbers"


def test_a_first_row_that_is_cut_off_is_not_followed_either(caplog: pytest.LogCaptureFixture) -> None:
    """`numpy.savetxt` has its header in a comment; the line after it is read with it."""
    sent, _ = follow("", BUDGET_S / 1000, ((2, "50,7"),))
    assert not sent
    assert "stdin:2:1: the last row has no end of line" in caplog.text
