"""A rate the wire cannot carry is refused; one that may not fit is reported."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from contid.control.daemon.run_request import RunRequest, load
from contid.errors import BadInputError, ContidError
from contid.hal import ExchangeTime
from contid.robot_file import tick_rate
from contid.robot_file.document import BusWiring
from contid.robot_file.load import parse_robot_file
from contid.robot_file.tick_rate import exchange_time, rate_finding, rate_too_high, watchdog_too_short


def finger(configs: Path, **values: object) -> str:
    text = (configs / "finger.emulated.yaml").read_text()
    for key, value in values.items():
        old = next(line for line in text.splitlines() if line.strip().startswith(f"{key}: "))
        text = text.replace(old, f"{old.partition(':')[0]}: {value}")
    return text


def test_a_rate_beyond_the_wire_is_refused_at_its_line(configs: Path) -> None:
    text = finger(configs, baud=57600)
    with pytest.raises(BadInputError) as raised:
        parse_robot_file(text, "slow.yaml")
    (found,) = raised.value.findings
    assert text.splitlines()[found.line - 1] == "rate_hz: 200"
    assert "2 servos at 57600 baud" in found.message
    highest = float(found.message.partition("at most ")[2].partition(" Hz")[0])
    assert 40.0 < highest < 62.0
    fits = parse_robot_file(finger(configs, baud=57600, rate_hz=highest), "slow.yaml")
    (bus,) = fits.buses.values()
    time = exchange_time(bus)
    assert time is not None
    assert rate_finding("servos", time, highest).ok
    assert not rate_finding("servos", time, highest).warning
    assert rate_finding("servos", time, highest + 2.0).warning


def test_a_recorded_file_of_such_a_rate_still_opens(configs: Path) -> None:
    assert parse_robot_file(finger(configs, baud=57600), "old.yaml", recorded=True).file.rate_hz == 200


def test_the_rate_of_a_run_is_checked_unless_its_devices_are_simulated(tmp_path: Path, configs: Path) -> None:
    path = tmp_path / "slow.yaml"
    path.write_text(finger(configs, baud=57600, rate_hz=40))
    with pytest.raises(ContidError, match="--rate: 100 Hz is too fast for the wire of bus 'servos'"):
        load(RunRequest(str(path), rate_hz=100.0))
    assert load(RunRequest(str(path), rate_hz=100.0, mock=True)).buses["servos"].driver == "sim"


@pytest.mark.parametrize("watchdog_ms", [5, 7, 35, 70, 90, 110, 130, 300])
def test_the_rate_that_a_short_watchdog_names_is_allowed(watchdog_ms: int) -> None:
    bus = cast(BusWiring, SimpleNamespace(name="b", options=SimpleNamespace(watchdog_ms=watchdog_ms)))
    (message,) = watchdog_too_short([bus], 0.5)
    named_hz = float(message.partition("at least ")[2].partition(" Hz")[0])
    assert list(watchdog_too_short([bus], named_hz)) == []
    assert list(watchdog_too_short([bus], 0.999 * named_hz)) != []


def test_the_rate_that_a_slow_wire_allows_is_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tick_rate, "exchange_time", lambda bus: ExchangeTime(0.0013, 0.004, "3 axes"))
    bus = cast(BusWiring, SimpleNamespace(name="b"))
    (message,) = rate_too_high([bus], 1100.0)
    assert "at most 225 Hz fit in every case, 769 Hz are allowed" in message
    assert list(rate_too_high([bus], 769.0)) == []
    assert list(rate_too_high([bus], 770.0)) != []
