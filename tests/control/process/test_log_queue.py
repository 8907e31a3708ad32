"""Log records become events: of any thread, of any level, bounded, and without failing their caller."""

from __future__ import annotations

import logging
import threading

import pytest

from contid.control.engine.events import RunEvent
from contid.control.engine.events.run import LogWritten
from contid.control.process.log_queue import CAPACITY, LogQueue, handle_logs

log = logging.getLogger("contid_drivers.any")


class Events:
    """Collects events."""

    def __init__(self) -> None:
        self.events: list[RunEvent] = []

    def write(self, values: list[float]) -> None:
        raise AssertionError("log records are events")

    def event(self, event: RunEvent) -> None:
        self.events.append(event)


def messages(queue: LogQueue) -> list[tuple[str, str]]:
    return [(line.level, line.message) for line in queue.take()]


def test_records_of_every_thread_are_published_in_order() -> None:
    queue, sink = LogQueue("control"), Events()
    with handle_logs(logging.INFO, queue):
        for number in range(3):
            thread = threading.Thread(target=log.warning, args=("number %d", number))
            thread.start()
            thread.join()
    assert sink.events == []
    queue.write(sink, at_most=2)
    queue.write(sink)
    assert sink.events == [
        LogWritten(process="control", level="warning", logger=log.name, message=f"number {number}")
        for number in range(3)
    ]


def test_only_records_from_the_level_are_taken_and_the_level_is_restored() -> None:
    queue, before = LogQueue("control"), logging.getLogger().level
    with handle_logs(logging.INFO, queue):
        log.debug("hidden")
        log.info("shown")
    log.error("later")
    assert messages(queue) == [("info", "shown")]
    assert logging.getLogger().level == before


@pytest.mark.parametrize(("level", "name"), [(1, "debug"), (25, "info"), (30, "warning"), (99, "critical")])
def test_a_level_without_a_name_becomes_the_next_lower_one(level: int, name: str) -> None:
    queue = LogQueue("control")
    with handle_logs(1, queue):
        log.log(level, "message")
    assert messages(queue) == [(name, "message")]


def test_an_exception_is_recorded_with_its_traceback() -> None:
    queue = LogQueue("control")
    with handle_logs(logging.INFO, queue):
        try:
            raise ValueError("broken")
        except ValueError:
            log.exception("failed")
    ((level, message),) = messages(queue)
    assert level == "error"
    assert message.startswith("failed\nTraceback")
    assert message.endswith("ValueError: broken")


def test_a_wrong_format_string_does_not_fail_the_caller(capsys: pytest.CaptureFixture[str]) -> None:
    queue = LogQueue("control")
    record = logging.LogRecord(log.name, logging.WARNING, __file__, 1, "%d", ("text",), None)
    queue.handle(record)
    assert messages(queue) == []
    assert "Logging error" in capsys.readouterr().err


def test_a_flood_keeps_the_newest_records() -> None:
    queue = LogQueue("control")
    with handle_logs(logging.INFO, queue):
        for number in range(CAPACITY + 5):
            log.info("%d", number)
    kept = messages(queue)
    assert len(kept) == CAPACITY
    assert kept[-1] == ("info", str(CAPACITY + 4))
