"""Messages arrive complete and in order, and the end of the pipe is detected."""

from __future__ import annotations

import io
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.messages import EndOfRows, Estop, Goto, Hold, Play, Rows
from contid.control.process.pipe import Inbox, frame, to_shared_memory
from contid.robot_file.load import parse_robot_file
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from tests.support.fingers import circle_csv, fingers


def test_messages_are_complete_when_bytes_arrive_one_by_one() -> None:
    read, write = os.pipe()
    inbox = Inbox(read)
    sent = [Hold(("a",)), Rows({"a": Target(tip_m=(1.0, 2.0, 0.1)), "b": None}), EndOfRows()]
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


def test_arrays_of_a_long_trajectory_are_mapped_and_their_file_is_removed(tmp_path: Path) -> None:
    loaded = parse_robot_file(fingers(1), "fingers.yaml")
    text = circle_csv(1, period_s=50.0)
    trajectory = read_trajectory(io.StringIO(text), "circle", loaded.driven)
    read, write = os.pipe()
    inbox = Inbox(read)
    bulk = to_shared_memory(Play(trajectory), tmp_path)
    assert bulk is not None
    piece = frame(bulk)
    assert len(piece) < len(pickle.dumps(trajectory)) / 3
    os.write(write, piece + frame(Estop()))
    play, estop = inbox.poll()
    assert estop == Estop()  # in the same tick, for any length of trajectory
    assert isinstance(play, Play)
    assert list(tmp_path.iterdir()) == []
    assert not play.trajectory.rows.flags.writeable
    for time_s in np.linspace(trajectory.start_s, trajectory.end_s, 301):
        assert play.trajectory.targets_at(float(time_s)) == trajectory.targets_at(float(time_s))
    assert to_shared_memory(Estop(), tmp_path) is None
    os.close(write)
    os.close(read)


def test_wait_takes_one_message_and_leaves_the_rest() -> None:
    read, write = os.pipe()
    inbox = Inbox(read)
    goto = Goto("a", Target(actuation=(0.1, 0.2)))
    os.write(write, frame(goto) + frame(EndOfRows()))
    assert inbox.wait() == goto
    assert inbox.poll() == [EndOfRows()]
    os.close(write)
    with pytest.raises(EOFError):
        inbox.wait()
    os.close(read)
