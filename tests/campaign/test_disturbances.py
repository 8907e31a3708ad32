"""Kills and suspensions of daemons on Due boards and servos; ``CONTID_CAMPAIGN=1`` tries every kind."""

from __future__ import annotations

import os
import random

import pytest

from tests.campaign.disturbances import KINDS, obstacle, one
from tests.campaign.disturbed_daemon import PLANTS

pytestmark = pytest.mark.campaign

ALL = [(plant, kind) for plant in PLANTS for kind in KINDS]
SHORT = [("lab", "kill control process"), ("chain", "suspend"), ("chain", "epoch"), ("lab", "quota")]


# Against real time: watchdogs of devices expire while a machine stands still.
@pytest.mark.realtime
@pytest.mark.parametrize(("plant", "kind"), ALL if os.environ.get("CONTID_CAMPAIGN") else SHORT)
def test_nothing_is_unsafe_or_left_behind(plant: str, kind: str) -> None:
    if why := obstacle(kind):
        pytest.skip(why)
    assert one(plant, kind, random.Random(18), longest_s=2.0) == []
