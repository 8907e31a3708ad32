"""Ten thousand random spellings of an emergency stop; some of them over a real, flooded socket."""

from __future__ import annotations

import os
import random

import pytest

from contid.remote.protocol.wire import is_estop
from tests.campaign.spellings import Spellings
from tests.campaign.stops import siege

pytestmark = pytest.mark.campaign

COUNT = 10_000


def test_every_random_spelling_is_recognised() -> None:
    lines = Spellings(random.Random(18))
    spellings = {lines.estop() for _ in range(COUNT)}
    assert len(spellings) > 0.8 * COUNT
    assert [line for line in spellings if not is_estop(line + b"\n")] == []


def test_no_random_request_with_another_verb_is_a_stop() -> None:
    lines = Spellings(random.Random(19))
    assert [line for line in (lines.other() for _ in range(COUNT)) if is_estop(line + b"\n")] == []


@pytest.mark.realtime
def test_stops_arrive_beside_random_floods() -> None:
    assert siege(COUNT if os.environ.get("CONTID_CAMPAIGN") else 20, 18) == 0
