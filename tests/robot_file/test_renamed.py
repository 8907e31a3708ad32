"""Keys of robot files that were renamed: refused with the new name, accepted in recordings."""

from __future__ import annotations

import pytest

from contid.errors import BadInputError
from contid.robot_file.load import parse_robot_file

FILE = """\
contid: 1
name: old
rate_hz: 100
buses:
  air: {driver: sim}
robots:
  arm:
    model: tri_rack
    geometry: {rack_radius_mm: 30}
    limits: {length_mm: [[100, 150]]}
    rates: {velocity_mm_s: 60, acceleration_mm_s2: 600, jerk_mm_s3: 12000}
    axes:
      s1.l1: {bus: air, device: servo, mm_per_rev: 40, dead_man: relax}
      s1.l2: {bus: air, device: servo, mm_per_rev: 40}
      s1.l3: {bus: air, device: servo, mm_per_rev: 40}
    placeholder: [axes.s1.l1.dead_man]
"""


def test_an_old_key_is_refused_where_it_stands_with_its_new_name() -> None:
    with pytest.raises(BadInputError) as caught:
        parse_robot_file(FILE, "old.yaml")
    line = FILE.splitlines().index(next(row for row in FILE.splitlines() if "dead_man: relax" in row)) + 1
    column = FILE.splitlines()[line - 1].index("dead_man") + 1
    assert f"old.yaml:{line}:{column}: key 'dead_man' was renamed; write 'on_watchdog'" in str(caught.value)


def test_a_recorded_file_keeps_the_meaning_of_its_old_keys() -> None:
    recorded = parse_robot_file(FILE, "old.yaml", recorded=True)
    today = parse_robot_file(FILE.replace("dead_man", "on_watchdog"), "old.yaml")
    assert recorded.buses == today.buses
    assert recorded.file == today.file
    assert dict(recorded.buses["air"].axes)["arm.s1.l1"].model_dump()["on_watchdog"] == "relax"
    assert recorded.text == FILE
