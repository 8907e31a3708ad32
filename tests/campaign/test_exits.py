"""SIGTERM in some states; ``CONTID_CAMPAIGN=1`` or `python -m tests.campaign.exits` try every one."""

from __future__ import annotations

import os
import random
from collections.abc import Callable

import pytest

from tests.campaign.exits import STATES, Exits

pytestmark = pytest.mark.campaign

SHORT = (
    *(Exits.waiting_for_stdin, Exits.board_that_does_not_answer, Exits.approach, Exits.stopping),
    *(Exits.bus_gone, Exits.bus_hangs, Exits.recording),
)


# Against real time: a machine that stands still for a second may be asked again.
@pytest.mark.realtime
@pytest.mark.parametrize(
    "state", STATES if os.environ.get("CONTID_CAMPAIGN") else SHORT, ids=lambda state: state.__name__
)
def test_sigterm_ends_every_process_in_time(state: Callable[[Exits], None]) -> None:
    assert Exits(random.Random(1)).leave(state).violations() == []
