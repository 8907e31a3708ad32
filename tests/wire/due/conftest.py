"""Boards behind a pty for the tests of the Due driver."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from contid.control.engine.cycle import RealClock
from contid_drivers.due.bus import DueBus
from contid_drivers.due.options import DueBusOptions, Role
from contid_emulate.due import DueEmulator
from tests.wire.due.boards import MOTORS


@pytest.fixture
def world(tmp_path: Path) -> Iterator[Callable[..., tuple[DueBus, DueEmulator]]]:
    """Makes a bus and the board behind it: ``world(axes, **bus options)``."""
    with ExitStack() as stack:

        def make(axes=MOTORS, role=Role.MOTOR, **keys) -> tuple[DueBus, DueEmulator]:
            options = DueBusOptions(port=str(tmp_path / "board"), role=role, **{"latency_ms": 60.0, **keys})
            emulator = stack.enter_context(DueEmulator(options, axes))
            bus = DueBus("board", options, axes, RealClock())
            stack.callback(bus.close)
            return bus, emulator

        yield make
