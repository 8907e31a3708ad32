"""What comes in on stdin is read as the same bytes in a file are, and a line without end is refused."""

from __future__ import annotations

import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np
import pytest

from contid.control.daemon.inputs import CancellableReader, Stream, read_file, read_stdin
from contid.control.daemon.run import run
from contid.control.daemon.run_request import RunRequest
from contid.errors import BadInputError, ContidError
from contid.robot_file.load import load_named
from contid.trajectory.timed import Trajectory
from contid.units import MAX_LINE

ROWS = b"t_s,x_mm,y_mm\n0,20,80\n1,21,80\n"
ROBOTS = load_named("finger").file.robots


@contextmanager
def piped(data: bytes) -> Iterator[TextIO]:
    """The end of a pipe that gives ``data`` and then ends."""
    read, write = os.pipe()

    def feed() -> None:
        with os.fdopen(write, "wb") as end:
            end.write(data)

    thread = threading.Thread(target=feed)
    thread.start()
    with os.fdopen(read) as stdin:
        yield stdin
    thread.join()


def from_stdin(data: bytes) -> Trajectory | Stream:
    reader = CancellableReader()
    try:
        with piped(data) as stdin:
            return read_stdin(stdin, ROBOTS, reader)
    finally:
        reader.close()


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(ROWS, id="plain"),
        pytest.param(b"\xef\xbb\xbf" + ROWS, id="byte order mark"),
        pytest.param(b"\xef\xbb\xbf# of a spreadsheet\n" + ROWS, id="byte order mark before a comment"),
        pytest.param(ROWS + b"# caf\xe9\n", id="Latin-1 in a comment"),
        pytest.param(b"# " + b"long " * MAX_LINE + b"\n" + ROWS, id="a comment without limits"),
    ],
)
def test_stdin_has_the_rows_of_a_file(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_bytes(data)
    in_file, piped_in = read_file(str(tmp_path / "t.csv"), ROBOTS), from_stdin(data)
    assert isinstance(piped_in, Trajectory)
    np.testing.assert_array_equal(piped_in.rows, in_file.rows)
    assert list(piped_in.lines) == list(in_file.lines)


def test_what_is_not_utf_8_is_refused_where_it_stands() -> None:
    with pytest.raises(BadInputError, match=r"stdin:4:3: x_mm"):
        from_stdin(ROWS + b"2,2\xe9,80\n")


def test_a_line_without_end_is_refused() -> None:
    """As of ``/dev/zero``: it was read until the memory was full."""
    reader = CancellableReader()
    with Path("/dev/zero").open() as endless, pytest.raises(BadInputError, match="longer than"):
        read_stdin(endless, ROBOTS, reader)
    reader.close()


@pytest.mark.parametrize("begin", [b"", ROWS])
def test_a_connection_that_is_reset_is_named(begin: bytes) -> None:
    """It was reported as an output that cannot be written."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        ours = socket.create_connection(server.getsockname())
        theirs, _ = server.accept()
    theirs.sendall(begin)
    reader = CancellableReader()
    with ours, ours.makefile() as stdin:
        if begin:
            ours.recv(len(begin), socket.MSG_PEEK)  # it has arrived
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        theirs.close()
        with pytest.raises(ContidError, match=r"stdin: cannot be read: Connection reset"):
            read_stdin(stdin, ROBOTS, reader)
    reader.close()


def test_a_stream_behind_a_byte_order_mark_and_a_comment() -> None:
    found = from_stdin(b"\xef\xbb\xbf# live\nx_mm,y_mm\n20,80\n")
    assert isinstance(found, Stream)
    assert (found.number, found.pending, found.parser.columns) == (2, (), ("x_mm", "y_mm"))


def test_a_virtual_run_without_an_input_leaves_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The corrected command was refused: the log existed."""
    monkeypatch.setattr("sys.stdin", None)
    log = tmp_path / "log.csv"
    with pytest.raises(ContidError, match="nothing to follow"):
        run(RunRequest(robot_file="finger", virtual=True, log=log))
    assert not log.exists()


def test_a_blank_line_after_a_header_in_a_comment_is_none_on_stdin_either(tmp_path: Path) -> None:
    text = ROWS.replace(b"t_s,x_mm,y_mm\n", b"# t_s,x_mm,y_mm\n\n")
    path = tmp_path / "rows.csv"
    path.write_bytes(text)
    with piped(text) as stdin, closing(CancellableReader()) as reader:
        found = read_stdin(stdin, ROBOTS, reader)
    assert isinstance(found, Trajectory)
    assert np.array_equal(found.rows, read_file(str(path), ROBOTS).rows)
