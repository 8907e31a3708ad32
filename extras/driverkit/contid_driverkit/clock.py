"""The clock of a bus that is opened outside a run: for homing, doctor and tests."""

from __future__ import annotations

import time


class MonotonicClock:
    """The host's monotonic clock (`contid.hal.Clock`)."""

    now = staticmethod(time.monotonic)
    sleep = staticmethod(time.sleep)
