"""A ring-down scales the schedule of input shaping, and does not take it away."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from contid.errors import ContidError
from contid.robot_file.edit import Change, set_values
from contid.robot_file.load import load_named
from contid_identify.estimate import Interval
from contid_identify.ring_down import FreeMode, RingDown
from contid_identify.stages import IdentifiedMotion
from contid_identify.written import changes, shape_of

SCHEDULE = (
    "      shape: {frequency_hz: 4, damping_ratio: 0.1, schedule: {middle: [0.5, 0.5, 0.5], half: [1, 1, 1], "
    "least_hz: 2, most_hz: 8, first: [1.4, 0.1, 0.2, -0.1, 0, 0, 0, 0, 0, 0], "
    "second: [1.5, 0.1, 0.2, -0.1, 0, 0, 0, 0, 0, 0]}}\n"
)


def ring(frequency_hz: float) -> RingDown:
    mode = FreeMode(Interval(frequency_hz, 0.01), Interval(0.08, 0.01))
    return RingDown(np.array([0.9e5, 0.2e5, 0.4e5]), (mode,), 3, 1e-4, (frequency_hz, frequency_hz))


def test_a_mode_that_cannot_be_shaped_leaves_the_other_values() -> None:
    """A delay that is known is written; alone, the mode is refused as before."""
    (robot,) = load_named("stiffflop1").driven.values()
    known = Interval(0.02, 0.001)
    axis = SimpleNamespace(name="c1", answer=SimpleNamespace(sum_s=known, delay_s=known, lag_s=known))
    found = SimpleNamespace(axes=(axis,), tip=None, body=None, ring_downs=(ring(500.0),))
    of_file = changes(cast(IdentifiedMotion, found), robot, "a shake")
    edits, left_out = of_file.changes, of_file.left_out
    assert "axes.c1.follow_delay_ms" in {edit.key for edit in edits}
    assert all(not edit.key.startswith("rates") for edit in edits)
    assert len(left_out) == 1
    assert left_out[0].startswith("rates.shape: 500 ")
    found.axes = ()
    with pytest.raises(ContidError, match=r"rates\.shape: 500 "):
        changes(cast(IdentifiedMotion, found), robot, "a shake")


def test_axes_that_are_not_known_are_named_beside_those_that_are_written() -> None:
    (robot,) = load_named("stiffflop1").driven.values()
    known, wide, open_end = Interval(0.02, 0.001), Interval(0.9, 0.3), Interval(0.9, math.inf)
    answers = {
        "both": SimpleNamespace(sum_s=known, delay_s=known, lag_s=known),
        "sum": SimpleNamespace(sum_s=known, delay_s=wide, lag_s=wide),
        "wide": SimpleNamespace(sum_s=wide, delay_s=wide, lag_s=wide),
        "open": SimpleNamespace(sum_s=open_end, delay_s=open_end, lag_s=open_end),
        "still": None,
    }
    axes = tuple(
        SimpleNamespace(name=name, answer=answer, refused="it hardly moved")
        for name, answer in answers.items()
    )
    found = SimpleNamespace(axes=axes, tip=None, body=None, ring_downs=())
    of_file = changes(cast(IdentifiedMotion, found), robot, "steps")
    assert {edit.key.split(".")[1] for edit in of_file.changes} == {"both", "sum"}
    assert of_file.left_out == []
    assert [each.split(": ")[0] for each in of_file.unknown] == [
        "axes.sum.follow_least_delay_ms, follow_least_lag_ms", "axes.wide", "axes.open", "axes.still",
        "dynamics.delay_ms, lag_ms",
    ]  # fmt: skip
    assert of_file.unknown[1].endswith("900 +- 300 ms; allowed: +- 50 ms")
    assert of_file.unknown[2].endswith("not fixed by these data; allowed: +- 50 ms")
    found.axes = axes[2:]
    with pytest.raises(ContidError, match=r"axes\.wide: .* 900 \+- 300 ms; .*; axes\.still: it hardly moved"):
        changes(cast(IdentifiedMotion, found), robot, "steps")


@pytest.mark.parametrize("schedule", ["", SCHEDULE])
def test_a_shake_scales_the_schedule(schedule: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text(load_named("stiffflop1").text.replace("    rates:\n", f"    rates:\n{schedule}", 1))
    (robot,) = load_named(str(path)).driven.values()
    change = shape_of(ring(5.5), robot, "a shake")
    (name,) = load_named(str(path)).driven
    set_values(path, [Change(f"robots.{name}.{change.key}", change.value, change.comment)])
    (after,) = load_named(str(path)).driven.values()
    assert after.rates.shape is not None
    if not schedule:
        assert (after.rates.shape.frequency_hz, after.rates.shape.damping_ratio) == (5.5, 0.08)
        return
    new = after.rates.shape.schedule
    assert new is not None
    assert new.frequencies([0.9, 0.2, 0.4])[0] == pytest.approx(5.5)
    assert robot.rates.shape is not None
    old = robot.rates.shape.schedule
    assert old is not None
    share = new.frequencies([0.3, 0.6, 0.5])[0] / old.frequencies([0.3, 0.6, 0.5])[0]
    assert share == pytest.approx(after.rates.shape.frequency_hz / 4.0)


def test_a_schedule_stays_in_what_shaping_takes_and_its_comment_has_what_is_new(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    slow = SCHEDULE.replace("frequency_hz: 4", "frequency_hz: 0.6")
    path.write_text(load_named("stiffflop1").text.replace("    rates:\n", f"    rates:\n{slow}", 1))
    (robot,) = load_named(str(path)).driven.values()
    change = shape_of(ring(1.0), robot, "a shake")
    assert isinstance(change.value, dict)
    assert (change.value["frequency_hz"], change.value["damping_ratio"]) == (0.5, 0.1)
    assert change.comment == "a shake: scaled to 1 +- 0.01 Hz at its pose, ratio as before"


@pytest.mark.parametrize(
    ("mass", "damping", "keys", "reason"),
    [
        (Interval(1.1, 0.137), Interval(0.004, 0.001), ["mass_g_per_m", "damping_ms"], ""),
        (Interval(1.1, 0.137), Interval(0.004, math.inf), ["mass_g_per_m"], "damping_ms is not written"),
        (Interval(1.1, math.inf), Interval(0.004, 0.001), [], "the mass of the body is not written"),
    ],
)
def test_what_is_not_known_of_a_body_is_left_out_with_its_reason(
    mass: Interval, damping: Interval, keys: list[str], reason: str
) -> None:
    (robot,) = load_named("tendon3").driven.values()
    stage = SimpleNamespace(kept_out=SimpleNamespace(rmse=1.2e-4))
    body = SimpleNamespace(mass=mass, damping_s=damping, stages=[stage])
    known = Interval(0.02, 0.001)
    axis = SimpleNamespace(name="c1", answer=SimpleNamespace(sum_s=known, delay_s=known, lag_s=known))
    found = SimpleNamespace(axes=(axis,), tip=None, body=body, ring_downs=())
    of_file = changes(cast(IdentifiedMotion, found), robot, "a shake")
    edits, left_out = of_file.changes, of_file.left_out
    written = {
        edit.key.removeprefix("dynamics."): edit
        for edit in edits
        if "_g" in edit.key or "damping" in edit.key
    }
    assert [key for key in written if key != "tip_mass_g"] == keys
    assert all("inf" not in edit.comment and "e+" not in edit.comment for edit in edits)
    if keys:
        assert "+- 12 %" in written["mass_g_per_m"].comment
    assert len(left_out) == bool(reason)
    assert not reason or reason in left_out[0]
