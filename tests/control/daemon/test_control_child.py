"""A control process that does not read its orders: stops wait for it, others are dropped."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest

from contid.control.daemon import control_child
from contid.control.daemon.control_child import ControlChild
from contid.control.daemon.spawn import Spawned
from contid.control.engine.messages import Estop, Finish, Hold, Mark, Message, Resume, Stop
from contid.control.process.pipe import Inbox


@pytest.mark.process
def test_stops_pass_a_full_backlog_and_what_is_dropped_is_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(control_child, "MAX_BACKLOG", 1000)
    read, write = os.pipe()
    os.set_blocking(write, False)
    child = ControlChild(Spawned(subprocess.Popen([sys.executable, "-c", ""]), write))
    inbox = Inbox(read)
    found: list[object] = []
    caplog.set_level(logging.WARNING)
    sent = 0
    while not caplog.records:
        sent += 1
        child.send(Mark(sent))
        assert sent < 100_000
    stops: list[Message] = [Stop(), Hold(("f0",)), Estop(), Finish()]
    for order in (Resume(), *stops, Resume()):
        child.send(order)
    while len(found) < sent - 1 + len(stops):
        found += inbox.poll()
        child.flush()
    child.send(Mark(0))
    found += inbox.poll()
    assert found == [*(Mark(number) for number in range(1, sent)), *stops, Mark(0)]
    assert [record.levelname for record in caplog.records] == ["ERROR", "WARNING"]
    assert "3 messages were dropped" in caplog.text
    child.close()
    os.close(read)
