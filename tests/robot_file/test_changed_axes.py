"""An axis that is not as it was brought up slows its robot, and that alone."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from contid.control.engine.cycle import RealClock
from contid.control.engine.wiring import open_buses
from contid.errors import DeviceNotFoundError
from contid.robot_file.load import parse_robot_file, with_mock
from contid.robot_file.proven.bringup import bringup_findings, proofs, wiring_digest

CONFIG = Path(__file__).parents[2] / "configs" / "hand.emulated.yaml"


def brought_up(axis: str, verdict: str = "ok", change: tuple[str, str] = ("", "")) -> str:
    """The shipped hand with one proven axis, changed afterwards."""
    text = CONFIG.read_text()
    buses = parse_robot_file(text, "hand.yaml").buses.values()
    bus = next(bus for bus in buses if axis in dict(bus.axes))
    entry = f"date: today, verdict: {verdict}, wiring: {wiring_digest(bus, axis)}, device: x, firmware: '1'"
    return text.replace(*change, 1) + f"\nbringup:\n  {axis}: {{{entry}}}\n"


def velocities(text: str) -> dict[str, float]:
    driven = parse_robot_file(text, "hand.yaml").driven
    return {name: robot.rate_limits[0][0] for name, robot in driven.items()}


def test_only_the_robot_of_a_changed_axis_is_slow() -> None:
    loaded = parse_robot_file(CONFIG.read_text(), "hand.yaml")
    (first, second), axis = list(loaded.driven)[:2], next(iter(loaded.buses.values())).axes[0][0]
    assert axis.startswith(first)
    before = velocities(CONFIG.read_text())
    assert velocities(brought_up(axis)) == before
    for text in (brought_up(axis, "no-count"), brought_up(axis, change=("id: 1,", "id: 9,"))):
        after = velocities(text)
        assert after[first] == pytest.approx(0.2 * before[first])
        assert after[second] == before[second]


def test_it_is_stated_by_check_and_when_a_run_opens_its_buses(caplog: pytest.LogCaptureFixture) -> None:
    axis = next(iter(parse_robot_file(CONFIG.read_text(), "hand.yaml").buses.values())).axes[0][0]
    loaded = parse_robot_file(brought_up(axis, change=("id: 1,", "id: 9,")), "hand.yaml")
    robot = axis.partition(".")[0]
    found = next(each for each in bringup_findings(loaded) if each.subject == f"bringup {axis}")
    assert found.warning
    assert found.message.endswith(f"{robot} moves at 20% of its velocities until it is brought up")
    slow = parse_robot_file(brought_up(axis, "no-count"), "hand.yaml")
    with caplog.at_level(logging.WARNING):
        for bus in open_buses(with_mock(slow), RealClock()).values():
            bus.close()
    assert not caplog.text
    with caplog.at_level(logging.WARNING), pytest.raises(DeviceNotFoundError):
        open_buses(slow, RealClock())
    assert f"{axis}: no-count at its last bring-up" in caplog.text


def test_every_axis_has_the_state_of_its_bring_up() -> None:
    """Clients get the same states as `contid check`: what was never brought up is pending, with its bus."""
    axes = [
        axis
        for bus in parse_robot_file(CONFIG.read_text(), "hand.yaml").buses.values()
        for axis, _ in bus.axes
    ]
    first, *others = axes
    for text, state, message in (
        (brought_up(first), "proven", "proven today"),
        (brought_up(first, "no-count"), "failed", "no-count at its last bring-up, today"),
        (brought_up(first, change=("id: 1,", "id: 9,")), "changed", "its wiring in this file was changed"),
    ):
        found = proofs(parse_robot_file(text, "hand.yaml"))
        assert list(found) == axes
        fields = found[first].as_fields()
        assert fields["message"].startswith(message)
        assert (fields["state"], fields["device"], fields["firmware"]) == (state, "x", "1")
        assert {found[each].state for each in others} == {"pending"}
        assert found[others[0]].as_fields()["driver"] == "dynamixel"
    mocked = proofs(with_mock(parse_robot_file(brought_up(first), "hand.yaml")))
    assert {each.state for each in mocked.values()} == {"none"}
