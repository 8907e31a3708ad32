"""A page that waits for its daemon ends with its exit code, while its thread still reads stdin."""

from __future__ import annotations

import signal
import socket
import subprocess
from pathlib import Path

import pytest

from tests.support.daemons import command

pytestmark = pytest.mark.process


def waiting(folder: Path, port: int = 0) -> subprocess.Popen[str]:
    arguments = ("panel", "--wait", "--socket", str(folder / "none.sock"), "--port", str(port))
    return subprocess.Popen(command(*arguments), stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_taken_port_is_exit_code_2(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with waiting(tmp_path, taken.getsockname()[1]) as process:
            assert process.stderr is not None
            printed = process.stderr.read()
            assert process.wait(60) == 2, printed
    assert "Fatal Python error" not in printed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, None])
def test_an_interrupt_and_the_end_of_stdin_end_it(tmp_path: Path, number: signal.Signals | None) -> None:
    with waiting(tmp_path) as process:
        assert process.stderr is not None
        assert process.stdin is not None
        assert "contid: panel: http" in process.stderr.readline()
        if number is None:
            process.stdin.close()
        else:
            process.send_signal(number)
        printed = process.stderr.read()
        assert process.wait(60) in (0, 130, -signal.SIGTERM, -signal.SIGINT), printed
    assert "Fatal Python error" not in printed
