"""A device that answers late in virtual time: ticks are skipped and counted, the run goes on, repeatably."""

from __future__ import annotations

import pytest

from contid.control.engine.virtual import run_virtual
from tests.support.fingers import Collector, circle, load

RATE = 200.0


@pytest.mark.parametrize(("delay_ms", "skips"), [(2.0, False), (12.0, True)])
def test_a_late_reply_skips_what_it_overran(delay_ms: float, skips: bool) -> None:
    runs = []
    for _ in range(2):
        loaded = load(1, options=f"faults: [{{at_s: 0.5, kind: late, for_s: 0.05, delay_ms: {delay_ms}}}]")
        sink = Collector(loaded)
        report = run_virtual(loaded, RATE, circle(loaded), sinks=[sink])
        assert report.exit_code == 0
        runs.append((report.ticks, report.skipped, repr(sink.records)))
    assert runs[0] == runs[1]
    assert (runs[0][1] > 0) == skips
