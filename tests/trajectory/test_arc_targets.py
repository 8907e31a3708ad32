"""Bends of sections as targets: columns to axes and back, against products of matrix exponentials."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from contid.cli.main import cli
from contid.control.engine.live.target_vector import kind_of, target_of, vector_of
from contid.control.engine.messages import Rows
from contid.control.engine.order_events import order_event
from contid.errors import BadInputError
from contid.kinematics.extra_axes import WithExtraAxes
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Bending, Model, build_model
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.load import load_named, parse_robot_file
from contid.robot_file.robot import RobotDescription
from contid.robot_file.sections import SectionRobot
from contid.targets import Target
from contid.trajectory.arc_columns import arc_names, arc_values
from contid.trajectory.read import read_trajectory
from contid.trajectory.rows import RowReader
from contid_sessions.replay.recorded_orders import order_of
from tests.oracles.twists import Chain

SPATIAL = ("trirack", "trirack2", "cbha", "tendon3", "ftdcr_v4")
#: Bends [deg] and lengths [mm] that are far inside the limits of each robot.
RANGES = {
    "finger": (30.0, (55.0, 65.0)),
    "trirack": (60.0, (200.0, 500.0)),
    "trirack2": (25.0, (110.0, 170.0)),
    "cbha": (15.0, (115.0, 125.0)),
    "tendon3": (20.0, (0.0, 0.0)),
    "ftdcr_v4": (15.0, (0.0, 0.0)),
}


def robot_of(name: str) -> RobotDescription:
    return next(iter(load_named(name).file.robots.values()))


def random_rows(name: str, robot: RobotDescription, count: int) -> np.ndarray:
    """Values of `arc_names`."""
    most_deg, lengths_mm = RANGES[name]
    rng = np.random.default_rng(len(name))
    kinds = {"bend_deg": (-most_deg, most_deg), "azimuth_deg": (-400.0, 400.0), "length_mm": lengths_mm}
    ranges = [kinds[column.partition(".")[2]] for column in arc_names(robot)]
    return np.array([[rng.uniform(*each) for each in ranges] for _ in range(count)])


def oracle_arcs(robot: RobotDescription, values: Sequence[float]) -> np.ndarray:
    """(u, v, L) of a row of `arc_names`."""
    each, found = iter(values), []
    for length in robot.section_lengths:
        bend = math.radians(next(each))
        azimuth = math.radians(next(each)) if robot.dimension == 3 else 0.0
        length_m = next(each) / 1e3 if length.changes else length.rest_m
        found.append((bend * math.cos(azimuth), bend * math.sin(azimuth), length_m))
    return np.array(found)


def oracle_tip(robot: RobotDescription, model: Model, arcs: np.ndarray) -> np.ndarray:
    """Tip in the base frame [m]: exponentials of twists, rigid pieces, offsets."""
    if robot.dimension == 2:  # along +y there, and bends to +x
        tip = Chain(lambda _: arcs, (model.tip_length_m,)).placed(np.zeros(1)).tip  # type: ignore[attr-defined]
        return np.array([tip[0], tip[2], 0.0])
    geometry = getattr(model, "geometry", None)
    if geometry is None:
        assert isinstance(robot, SectionRobot)
        return np.asarray(Chain(lambda _: arcs, robot.rigid_m).placed(np.zeros(1)).tip)
    x, y, z = geometry.tip_offset_m
    rigid = [section.rigid_m for section in geometry.sections]
    rigid[-1] += z
    tip = Chain(lambda _: arcs, tuple(rigid), (x, y)).placed(np.zeros(1)).tip
    return np.asarray(tip + np.array([0.0, 0.0, geometry.base_offset_m]))


@pytest.mark.parametrize("name", RANGES)
def test_bends_lead_to_the_tip_of_the_oracle_and_back(name: str) -> None:
    robot = robot_of(name)
    model = build_model(robot)
    assert isinstance(model, Bending)
    reader = RowReader(",".join(arc_names(robot)), "rows", {"r": robot})
    for values in random_rows(name, robot, 40).tolist():
        target = reader.layout.targets(reader.row(values, 1))["r"]
        found = model.inverse(target, robot.rest[: len(model.axis_names)])
        assert found.converged, (values, found)
        arcs = oracle_arcs(robot, values)
        np.testing.assert_allclose(model.arcs(found.actuation), arcs, atol=1e-12)
        np.testing.assert_allclose(
            model.forward(found.actuation).tip_m, oracle_tip(robot, model, arcs), atol=1e-11
        )
        again = oracle_arcs(robot, arc_values(robot, model.arcs(found.actuation).tolist()))
        np.testing.assert_allclose(again, arcs, atol=1e-12)


@pytest.mark.parametrize("name", ["finger", "trirack", "trirack2", "cbha"])
def test_a_length_that_is_left_out_is_the_one_nearest_to_rest_that_turns_within_the_limits(name: str) -> None:
    robot = robot_of(name)
    model = build_model(robot)
    assert isinstance(model, Bending)
    names = [each for each in arc_names(robot) if not each.endswith("length_mm")]
    reader = RowReader(",".join(names), "rows", {"r": robot})
    rest = robot.rest[: len(model.axis_names)]

    def met(bend_rad: float, azimuth: float, lengths: Sequence[float]) -> bool:
        u, v = bend_rad * math.cos(azimuth), bend_rad * math.sin(azimuth)
        arcs = tuple(value for length in lengths for value in (u, v, length))
        return model.inverse(Target(arcs=arcs), rest).converged

    turns = np.linspace(0.0, 2.0 * math.pi, 24).tolist() if robot.dimension == 3 else [0.0, math.pi]
    for bend in (0.0, 2.0, 12.0):
        target = reader.layout.targets(reader.row([bend] * len(names), 1))["r"]
        found = model.inverse(target, rest)
        assert found.converged
        lengths = model.arcs(found.actuation)[:, 2].tolist()
        bend_rad = math.radians(bend)
        assert all(met(bend_rad, azimuth, lengths) for azimuth in turns)
        for k, length in enumerate(robot.section_lengths):
            nearer = [*lengths[:k], lengths[k] + 0.05 * (length.rest_m - lengths[k]), *lengths[k + 1 :]]
            if abs(nearer[k] - lengths[k]) > 1e-9:
                assert not all(met(bend_rad, azimuth, nearer) for azimuth in turns)
    with pytest.raises(BadInputError, match=r"needs 's1.length_mm'"):
        RowReader(
            ",".join(each.replace("bend_deg", "curvature_per_m") for each in names), "rows", {"r": robot}
        )


@pytest.mark.parametrize("name", RANGES)
def test_a_curvature_is_a_bend_per_length(name: str) -> None:
    robot = robot_of(name)
    names = arc_names(robot)
    values = random_rows(name, robot, 1)[0]
    arcs = oracle_arcs(robot, values.tolist())
    curved = [
        values[k] if not each.endswith("bend_deg") else math.radians(values[k]) / arcs[int(each[1]) - 1, 2]
        for k, each in enumerate(names)
    ]
    header = ",".join(each.replace("bend_deg", "curvature_per_m") for each in names)
    reader = RowReader(header, "rows", {"r": robot})
    target = reader.layout.targets(reader.row(curved, 1))["r"]
    assert target.arcs == pytest.approx(tuple(arcs.ravel()), abs=1e-12)
    both = f"{header},s1.bend_deg"
    with pytest.raises(BadInputError, match="bend and the curvature of s1"):
        RowReader(both, "rows", {"r": robot})


def test_a_curve_through_wrapped_azimuths_is_one_through_components() -> None:
    robot = robot_of("trirack")
    text = "t_s,s1.bend_deg,s1.azimuth_deg,s1.length_mm\n0,60,170,300\n1,60,-170,300\n2,-60,30,300\n"
    with_steps = read_trajectory(io.StringIO(text), "rows", {"arm": robot})
    middle = with_steps.targets_at(0.5)["arm"].arcs
    assert middle is not None
    assert math.hypot(*middle[:2]) > math.radians(58.0)
    assert abs(math.degrees(math.atan2(middle[1], middle[0]))) > 165.0
    end = with_steps.targets_at(2.0)["arm"].arcs
    assert end == pytest.approx((-math.pi / 3 * math.cos(math.pi / 6), -math.pi / 6, 0.3))


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("s1.bend_deg", "needs 's1.azimuth_deg', 's2.bend_deg', 's2.azimuth_deg' beside it"),
        ("s1.bend_deg,s1.azimuth_deg,s2.bend_deg,s2.azimuth_deg,x_mm,y_mm,z_mm", "tip and arcs columns"),
        ("s1.bend_deg,s1.azimuth_deg,s2.bend_deg,s2.azimuth_deg,s3.bend_deg", "unknown column 's3.bend_deg'"),
        ("s1.bend_deg,s1.azimuth_deg,s2.bend_deg,s2.azimuth_deg,ax,ay,az", "goes with a tip only"),
    ],
)
def test_columns_that_do_not_state_a_shape_are_refused(header: str, message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        RowReader(header, "rows", {"arm": robot_of("trirack2")})


@pytest.mark.parametrize(
    ("name", "limit"), [("trirack", "s1.bend_radius"), ("tendon3", "s1"), ("finger", "")]
)
def test_a_bend_beyond_the_limits_is_not_met_and_names_one(name: str, limit: str) -> None:
    robot = robot_of(name)
    model = build_model(robot)
    sections = len(robot.section_lengths)
    target = Target(arcs=(6.0, 0.0, 0.06) * sections)
    found = model.inverse(target, robot.rest[: len(model.axis_names)])
    assert not found.converged
    assert found.residual_m > 1e-4
    assert any(each.startswith(limit) for each in found.limited_by)


def test_a_model_without_bends_refuses_them() -> None:
    robot, loaded = robot_of("tendon3"), load_named("tendon3")
    text = Path(loaded.path).read_text().replace("tension:", "rod: {weight_n_per_m: [0.5]}\n    tension:", 1)
    rod = next(iter(parse_robot_file(text, "rod.yaml").file.robots.values()))
    assert "arcs" not in rod.accepts
    with pytest.raises(BadInputError, match=r"unknown column 's1.bend_deg'"):
        RowReader(",".join(arc_names(robot)), "rows", {"arm": rod})


@pytest.mark.parametrize("name", ["stiffflop1", "stiffflop2"])
def test_bends_of_a_pneumatic_arm_without_loads_are_arcs(name: str) -> None:
    robot = robot_of(name)
    model = build_model(robot)
    assert isinstance(robot, Cosserat)
    assert isinstance(model, Bending)
    rigid = tuple(section.link_mm / 1e3 for section in robot.geometry.sections)
    rng = np.random.default_rng(3)
    for _ in range(10):
        bends = rng.uniform(-0.7, 0.7, (len(rigid), 2))
        asked = np.column_stack((bends, np.zeros(len(rigid))))
        found = model.inverse(Target(arcs=tuple(asked.ravel().tolist())), robot.rest)
        assert found.converged
        arcs = model.arcs(found.actuation)
        np.testing.assert_allclose(arcs[:, :2], bends, atol=1e-7)
        # A length that is left open takes the lowest pressures that a turn of the bend needs.
        above = np.reshape(found.actuation, (-1, 3)) - robot.lower[0]
        assert np.sqrt(2.0) * above.std(axis=1) == pytest.approx(above.mean(axis=1), abs=1.0)
        placed = Chain(lambda _, arcs=arcs: arcs, rigid).placed(np.zeros(1))  # type: ignore[misc]
        np.testing.assert_allclose(model.forward(found.actuation).tip_m, placed.tip, atol=1e-8)
        whole = tuple(arcs.ravel().tolist())
        assert model.inverse(Target(arcs=whole), robot.rest).actuation == pytest.approx(
            found.actuation, abs=0.5
        )


def test_bends_of_a_pneumatic_arm_under_a_load_are_those_of_its_ends() -> None:
    robot = robot_of("stiffflop1")
    model = build_model(robot)
    assert isinstance(model, Bending)
    load = (0.02, -0.04, 0.05)
    seed = robot.rest
    for azimuth in np.linspace(0.0, 6.0, 7).tolist():
        u, v = 0.4 * math.cos(azimuth), 0.4 * math.sin(azimuth)
        found = model.inverse(Target(arcs=(u, v, 0.054), load_n=load), seed)
        assert found.converged
        seed = found.actuation
        x, y, z = model.forward(seed, load).direction
        assert math.acos(z) == pytest.approx(0.4, abs=1e-6)
        assert math.remainder(math.atan2(y, x) - azimuth, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
        line = model.shape(seed, 801, load)
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(0.054, abs=1e-5)


def test_bends_that_no_pressures_have_hold_the_last_command() -> None:
    robot = robot_of("stiffflop1")
    found = build_model(robot).inverse(Target(arcs=(9.0, 0.0, 0.0)), robot.rest)
    assert (found.actuation, found.converged, found.limited_by) == (robot.rest, False, ("reach",))


def test_bends_pass_through_frames_live_vectors_recorded_orders_and_extra_axes() -> None:
    robot = robot_of("trirack")
    target = Target(arcs=(0.1, -0.2, 0.3), extra={"wrist": 0.5})
    assert BaseFrame.of(robot.base).target_in_base(target).arcs == target.arcs
    assert target_of(vector_of(target), target) == target
    assert kind_of(target) != kind_of(Target(actuation=(0.1, -0.2, 0.3), extra={"wrist": 0.5}))
    order = Rows({"arm": target})
    event = order_event(order, 7)
    assert event is not None
    event = replace(event, order=json.loads(json.dumps(event.order)))
    assert order_of(event) == order
    model = WithExtraAxes(build_model(robot), ("wrist",), {"wrist": (-1.0, 1.0)})
    found = model.inverse(target, (*robot.rest, 0.0))
    assert found.converged
    assert found.actuation[-1] == 0.5
    assert found.actuation[0] != robot.rest[0]


def test_bends_that_are_not_finite_hold_the_last_command() -> None:
    robot = robot_of("trirack")
    found = build_model(robot).inverse(Target(arcs=(math.nan, 0.0, 0.3)), robot.rest)
    assert found.actuation == robot.rest
    assert not found.converged


def contid(*words: str, stdin: str | None = None) -> str:
    """The output of a command in this process."""
    done = CliRunner().invoke(cli, words, input=stdin, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.mark.slow
def test_a_trajectory_of_bends_is_printed_checked_run_recorded_replayed_and_retimed(tmp_path: Path) -> None:
    ((name, robot),) = load_named("cbha").file.robots.items()
    names = arc_names(robot)
    header, line = ",".join(names), ",".join(map(str, random_rows("cbha", robot, 1)[0]))
    axes = contid("ik", "cbha", "--bare", stdin=f"{header}\n{line}\n")
    assert contid("fk", "cbha", stdin=axes) == contid("fk", "cbha", stdin=f"{header}\n{line}\n")
    printed = contid("fk", "cbha", "--bends", stdin=axes)
    assert printed.splitlines()[0] == header
    again = contid("fk", "cbha", "--bends", stdin=contid("ik", "cbha", "--bare", stdin=printed))
    first, second = (list(map(float, text.splitlines()[1].split(","))) for text in (printed, again))
    assert first == pytest.approx(second, abs=1e-9)

    path, session = tmp_path / "bends.csv", str(tmp_path / "bends.mcap")
    rows = (f"{t},{5.0 + t},{170.0 + 30.0 * t},120,{3.0 * t},-40,112" for t in range(4))
    path.write_text("\n".join((f"t_s,{header}", *rows)) + "\n")
    assert "within reach" in contid("check", "cbha", str(path))
    retimed = contid("retime", "cbha", str(path)).splitlines()
    assert retimed[0] == f"t_s,{header}"
    last = list(map(float, retimed[-1].split(",")))[1:]
    assert last == pytest.approx([8.0, -100.0, 120.0, 9.0, -40.0, 112.0], abs=1e-6)
    contid("run", "cbha", "--virtual", "--trajectory", str(path), "--record", session)
    assert "bit for bit" in contid("replay", session)
    contid("session", "export", session, "--csv", str(tmp_path / "out"))
    with (tmp_path / "out" / "target.csv").open() as file:
        targets = [row for row in csv.DictReader(file) if row[f"{name}.s1_l1_mm"]]
    end = contid("ik", "cbha", "--bare", stdin="\n".join((header, "8,260,120,9,-40,112", "")))
    first = list(map(float, end.splitlines()[1].split(",")[:6]))
    second = [float(targets[-1][f"{name}.s{s}_l{t}_mm"]) for s in (1, 2) for t in (1, 2, 3)]
    assert first == pytest.approx(second, abs=1e-9)


def test_bends_printed_under_a_load_do_not_depend_on_how_the_base_is_turned(tmp_path: Path) -> None:
    """Loads of rows are in the world: turned with the base, they bend the arm alike, and back."""
    text = load_named("stiffflop1").text
    seen = []
    for yaw_deg, load_n in ((0, "0.3,0,0"), (90, "0,0.3,0")):
        path = tmp_path / f"turned{yaw_deg}.yaml"
        path.write_text(
            text.replace("model: cosserat", f"model: cosserat\n    base: {{yaw_deg: {yaw_deg}}}", 1)
        )
        loads = "load.fx_n,load.fy_n,load.fz_n"
        axes = f"s1.p1_bar,s1.p2_bar,s1.p3_bar,{loads}\n0.6,0.3,0.2,{load_n}\n"
        header, bends = contid("fk", str(path), "--bends", stdin=axes).splitlines()
        tips = contid("fk", str(path), stdin=f"{header},{loads}\n{bends},{load_n}\n").splitlines()[1]
        tip, whole = (
            [float(each) for each in row.split(",")][:3]
            for row in (tips, contid("fk", str(path), stdin=axes).splitlines()[1])
        )
        assert tip == pytest.approx(whole, abs=1e-3)
        seen.append([float(each) for each in bends.split(",")])
    assert seen[0] == pytest.approx(seen[1], abs=1e-6)
