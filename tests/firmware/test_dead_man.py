"""The sketch's machine code stops its outputs in time, whatever fails.

`test_flashed.py` does the same with the real core.
"""

from __future__ import annotations

import pytest

from tests.firmware.dead_man import Failure, check
from tests.firmware.sam3x.build import build_sketch


@pytest.mark.slow
@pytest.mark.parametrize(
    ("failure", "watchdog_ms", "pressure"),
    [
        (Failure.DEMANDS, 100, False),
        pytest.param(Failure.DEMANDS, 20, True, marks=pytest.mark.campaign),
        pytest.param(Failure.READING, 100, False, marks=pytest.mark.campaign),
        (Failure.READING, 20, True),
        (Failure.LOOP, 20, False),
        pytest.param(Failure.LOOP, 100, True, marks=pytest.mark.campaign),
        (Failure.TICK, 100, False),
    ],
)
def test_outputs_are_safe_in_time(failure: Failure, watchdog_ms: int, pressure: bool):
    check(build_sketch(), failure, watchdog_ms, pressure)
