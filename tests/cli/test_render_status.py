"""Bars of `contid status`."""

from __future__ import annotations

import subprocess
import sys

import pytest

from contid.cli.support.render_status import BAR, bar
from tests.support.daemons import daemon


def test_bars_stay_within_their_width() -> None:
    assert [len(bar(value, 0.0, 10.0)) for value in (None, -5.0, 0.0, 5.0, 10.0, 50.0)] == [BAR] * 6
    assert bar(5.0, 0.0, 10.0).count("█") == BAR // 2


@pytest.mark.process
@pytest.mark.realtime
def test_a_watch_into_a_pipe_is_written_as_it_comes() -> None:
    with daemon() as running:
        watch = subprocess.Popen(
            [sys.executable, "-m", "contid", "status", "--watch", "--socket", str(running.socket)],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert watch.stdout is not None
            lines = iter(watch.stdout.readline, "")
            assert len([next(line for line in lines if "lease:" in line) for _ in range(2)]) == 2
        finally:
            watch.kill()
            watch.communicate()
