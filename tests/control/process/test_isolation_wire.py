"""What passes between the control process and a bus process, and between that and its keeper."""

from __future__ import annotations

import logging
import math
import os
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid.control.engine.ports import BusJob, BusReply
from contid.control.process.isolation.output import LINES_PER_S, LONGEST_LINE, LineLimit, PipeHandler
from contid.control.process.isolation.wire import BusWire
from contid.control.tick.state import Effect
from contid.hal import Sample

AXES = ("f.left", "f.right")
WIRE = BusWire(AXES)
NUMBERS = st.floats(width=64)
PERHAPS = st.none() | NUMBERS
SAMPLES = st.builds(
    Sample, value=PERHAPS, time_s=NUMBERS, valid=st.booleans(), age_s=NUMBERS, velocity=PERHAPS,
    effort=PERHAPS, temperature_c=PERHAPS, voltage_v=PERHAPS, tension_n=PERHAPS, fault=st.text(max_size=20),
)  # fmt: skip


@given(st.dictionaries(st.sampled_from(AXES), NUMBERS), st.booleans())
def test_a_job_arrives_as_it_was_sent(commands: dict[str, float], reopen: bool) -> None:
    effects = ((3, Effect.ENABLE, AXES), (4, Effect.RELAX, AXES[:1])) if reopen else ()
    job = BusJob(commands, effects, reopen)
    assert repr(WIRE.job_of(WIRE.job(job))) == repr(
        replace(job, commands={axis: commands[axis] for axis in AXES if axis in commands})
    )


@given(st.dictionaries(st.sampled_from(AXES), SAMPLES))
def test_samples_arrive_as_they_were_sent(samples: dict[str, Sample]) -> None:
    reply, _ = WIRE.reply_of(WIRE.reply(BusReply(samples), {}))
    assert reply.samples is not None
    assert repr(dict(reply.samples)) == repr({axis: samples[axis] for axis in AXES if axis in samples})
    assert (reply.lost, reply.done, reply.refused) == ("", [], [])


def test_what_became_of_requests_arrives_and_a_lost_bus() -> None:
    good = Sample(1.0, 2.0, True, 0.0)
    done, refused = [(0, Effect.CLEAR)], [(1, Effect.ENABLE, "not today")]
    extra = {"tips": [["arm", [0.0, 0.1, 0.2], 5.0]]}
    reply, rest = WIRE.reply_of(WIRE.reply(BusReply(dict.fromkeys(AXES, good), "", done, refused), extra))
    assert (reply.done, reply.refused, rest["tips"]) == (done, refused, extra["tips"])
    lost, _ = WIRE.reply_of(WIRE.reply(BusReply(lost="gone " * 1000), {}))
    assert lost.samples is None
    assert lost.lost.startswith("gone gone")
    assert len(lost.lost) <= 1000


def test_a_flood_is_cut_and_counted() -> None:
    limit = LineLimit("contid.bus.x")
    lines = [*limit.take(b"all is well\n" * 1000 + b"half a li", 10.0)]
    assert lines == [[logging.INFO, "contid.bus.x", "all is well"]] * LINES_PER_S
    assert not [*limit.take(b"ne\n", 10.5)]
    first, second = limit.take(b"\x1b[2J\n", 11.1)
    assert first == [logging.WARNING, "contid.bus.x", "981 more lines of output are left out"]
    assert second[2] == "?[2J"
    (long,) = limit.take(b"x" * 10 * LONGEST_LINE, 12.0)
    assert len(long[2]) == LONGEST_LINE


def test_log_records_keep_their_level_and_name() -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb", 0) as pipe:
        handler = PipeHandler(writing)
        handler.emit(logging.LogRecord("winch", logging.ERROR, "", 0, "two\nlines %d", (7,), None))
        handler.emit(logging.LogRecord("winch", logging.ERROR, "", 0, "y" * 10_000, (), None))
        os.close(writing)
        first, second = LineLimit("x").take(pipe.read(), 0.0)
    assert first == [logging.ERROR, "winch", "two\nlines 7"]
    assert second[:2] == [logging.ERROR, "winch"]


@pytest.mark.parametrize("text", ["\x00" * 500, "\U0001f916" * 500, '"' * 2000, "z" * 2000, "z\x00" * 400])
def test_a_long_record_keeps_its_level_however_many_bytes_its_escapes_take(text: str) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading, "rb", 0) as pipe:
        PipeHandler(writing).emit(logging.LogRecord("winch" * 100, logging.ERROR, "", 0, text, (), None))
        os.close(writing)
        line = pipe.read()
    (record,) = LineLimit("x").take(line, 0.0)
    assert record[0] == logging.ERROR
    assert record[1].startswith("winch")
    assert text.startswith(record[2])
    assert LONGEST_LINE - 24 <= len(line) <= LONGEST_LINE + 1  # cut by no more than two characters


@pytest.mark.parametrize("value", [math.nan, -0.0, math.inf])
def test_a_number_that_is_none_is_not_made_one(value: float) -> None:
    sample = Sample(value, 1.0, True, 0.0)
    reply, _ = WIRE.reply_of(WIRE.reply(BusReply({AXES[0]: sample}), {}))
    assert reply.samples is not None
    assert repr(reply.samples[AXES[0]].value) == repr(value)
