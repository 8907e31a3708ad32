"""Bends in the telemetry: finite without a known load, and of the load as the base sees it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

from contid.control.engine.wiring import build_robot_configs
from contid.kinematics.model import Bending
from contid.remote.server.live_rows import LiveRows
from contid.remote.server.robot_fields import bends_of
from contid.robot_file.load import configs_folder, load_named, parse_robot_file
from contid.targets import Target, Vec3

UNKNOWN = (math.nan, math.nan, math.nan)


def record(count: int, load_n: Vec3) -> Any:
    """What is read of a record."""
    return SimpleNamespace(axes=[SimpleNamespace(command=100.0)] * count, load_n=load_n)


@pytest.mark.parametrize("name", ["catheter", "chambers3", "hand", "stiffflop2", "trunk"])
def test_bends_are_finite_without_a_known_load(name: str) -> None:
    loaded = load_named(name)
    for config in build_robot_configs(loaded, 100.0):
        given = record(len(config.axis_names), UNKNOWN)
        given.axes = [SimpleNamespace(command=value) for value in config.rest]
        found = bends_of(config, loaded.driven[config.name], given)
        assert found is not None
        assert all(map(math.isfinite, found))


def test_a_load_is_turned_into_the_frame_of_the_base() -> None:
    text = (configs_folder() / "chambers3.yaml").read_text(encoding="utf-8")
    turned = text.replace("    model: cosserat\n", "    model: cosserat\n    base: {roll_deg: 90}\n")
    assert turned != text
    loaded = parse_robot_file(turned, "turned.yaml")
    (config,) = build_robot_configs(loaded, 100.0)
    found = bends_of(config, cast(Any, loaded.driven[config.name]), record(3, (0.0, 0.0, -0.2)))
    assert isinstance(config.model, Bending)
    # The world's down is -y of a base that is rolled by 90 degrees.
    bend = math.hypot(*config.model.arcs((100.0,) * 3, (0.0, -0.2, 0.0)).ravel()[:2])
    assert found is not None
    assert math.radians(found[0]) == pytest.approx(bend, rel=1e-9)
    assert bend > math.radians(0.1)


def test_a_step_of_bends_begins_at_those_under_the_load_of_its_target() -> None:
    loaded = load_named("stiffflop1")
    (config,) = build_robot_configs(loaded, 100.0)
    command = tuple(
        0.5 * (low + high) for low, high in zip(config.model.lower, config.model.upper, strict=True)
    )
    view = SimpleNamespace(configs={config.name: config}, command=lambda *_: command)
    target = Target(arcs=(0.1, 0.0, 0.05), load_n=(0.3, 0.0, 0.0))
    rows = LiveRows(view, None)  # type: ignore[arg-type]
    begin = rows.steps({config.name: target}, {}, None)[config.name].before
    assert isinstance(config.model, Bending)
    under_load = config.model.arcs(command, config.frame.vector_in_base(target.load_n))
    assert begin.arcs == tuple(under_load.ravel().tolist())
