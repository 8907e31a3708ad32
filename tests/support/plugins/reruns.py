"""Only `realtime` tests are tried again, and only up to the rate that CI allows."""

from __future__ import annotations

import os
from typing import Any

import pytest

# A virtual machine that stands still for a tenth of a second looks exactly like a dead bus, so `realtime`
# tests may be tried three times. `pytest_sessionfinish` limits how many need it.
# A stall often lasts longer than the start of the next try, hence the delay.
RERUNS = 3
RERUN_DELAY_S = 3


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every `realtime` test gets its further tries; a campaign counts its failures, none is hidden."""
    for item in items:
        if item.get_closest_marker("realtime") and not item.get_closest_marker("campaign"):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=RERUN_DELAY_S))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Name the tests that were tried again, and why: each is a failure that the next try has hidden."""
    for report in terminalreporter.stats.get("rerun", []):
        crash = getattr(report.longrepr, "reprcrash", None)
        lines = (crash.message if crash is not None else report.longreprtext).splitlines()
        terminalreporter.write_line(f"RERUN {report.nodeid} - {lines[0][:200] if lines else 'no message'}")


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Fail a run in which more than CONTID_MAX_RERUN_RATE of the tests had to be tried again (CI: 0.01)."""
    limit = os.environ.get("CONTID_MAX_RERUN_RATE")
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if limit is None or reporter is None or exitstatus != pytest.ExitCode.OK:
        return
    again = {report.nodeid for report in reporter.stats.get("rerun", [])}
    run = len(reporter.stats.get("passed", []))
    if len(again) > float(limit) * run:
        reporter.write_line(f"{len(again)} of {run} tests were tried again, allowed {float(limit):.1%}:")
        for test in sorted(again):
            reporter.write_line(f"  {test}")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
