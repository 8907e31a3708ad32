"""Every robot file that ships with contid loads, and every model in it can be built."""

from __future__ import annotations

from pathlib import Path

import pytest

from contid.control.engine.wiring import wired_buses
from contid.kinematics.model import build_model
from contid.robot_file.load import load_robot_file, with_mock

CONFIGS = sorted((Path(__file__).parent.parent.parent / "configs").glob("*.yaml"))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_shipped_robot_file_loads_and_its_rest_pose_is_a_fixed_point(path: Path) -> None:
    loaded = load_robot_file(path)
    assert all(bus.driver == "sim" for bus in with_mock(loaded).buses.values())
    for robot in loaded.file.robots.values():
        if robot.passive:
            continue
        model = build_model(robot)
        tip = model.forward(robot.rest).tip_m
        assert all(abs(value) < 10.0 for value in tip)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_axis_of_a_shipped_robot_file_reaches_its_driver_with_its_travel(path: Path) -> None:
    loaded = load_robot_file(path)
    wired = {axis.name for bus in wired_buses(loaded) for axis in bus.axes if axis.travel is not None}
    driven = [(name, robot) for name, robot in loaded.file.robots.items() if not robot.passive]
    assert wired == {f"{name}.{axis}" for name, robot in driven for axis in robot.all_axis_names}


@pytest.mark.parametrize(
    "twin", [path for path in CONFIGS if path.name.endswith(".emulated.yaml")], ids=lambda path: path.stem
)
def test_an_emulated_twin_differs_from_its_robot_only_in_names_and_ports(twin: Path) -> None:
    real = load_robot_file(twin.with_name(twin.name.replace(".emulated", "")))
    emulated = load_robot_file(twin)
    assert emulated.file.robots == real.file.robots
    assert emulated.file.rate_hz == real.file.rate_hz
    for name, bus in emulated.buses.items():
        other = real.buses[name]
        assert (bus.driver, bus.axes, bus.tolerance_ticks) == (
            other.driver,
            other.axes,
            other.tolerance_ticks,
        )
        assert bus.options.model_copy(update={"port": ""}) == other.options.model_copy(update={"port": ""})
