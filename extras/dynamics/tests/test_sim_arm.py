"""The simulated pneumatic arm: statics against other formulations, wall, payload, errors, tracker."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from contid.control.engine.cycle import VirtualClock
from contid.control.engine.wiring import open_buses
from contid.errors import BadInputError
from contid.hal import MeasuresTips
from contid.kernels import load
from contid.kinematics.cosserat.model import CosseratModel
from contid.robot_file.load import load_named, parse_robot_file, with_mock
from contid_dynamics.arm_body import SimulatedBody
from contid_dynamics.arm_statics import STEPS, arm_solver, section_constants
from studies.shi import forward
from tests.oracles.rod_shooting import shoot

ANYWHERE = (False, (0.0, 0.0, 0.0), 0.0)
FORCES = ((0.0, 0.0, 0.0), (0.005, -0.01, 0.05), (0.0, 0.0, 0.098))
SIM = "    sim:\n{keys}\n    stop: {{on_end"


def text_with(keys: str) -> str:
    """Stiffflop2 with a ``sim`` of these lines."""
    text = load_named("stiffflop2").text
    indented = "\n".join("      " + line for line in keys.splitlines())
    assert "\n    stop: {on_end" in text
    return text.replace("    stop: {on_end", SIM.format(keys=indented), 1)


def arm_with(keys: str = "payload_g: 0"):
    return parse_robot_file(text_with(keys), "arm.yaml").file.robots["arm"]


def pressures(count=6, seed=3):
    return np.random.default_rng(seed).uniform(0.1, 1.0, (count, 6))


@pytest.mark.parametrize("force", FORCES)
def test_without_errors_the_tip_is_that_of_the_model(force):
    robot = arm_with()
    model, solve = CosseratModel(robot), arm_solver(robot)
    for p in pressures():
        at = model.engine.forward(p.tolist(), force)
        found, unknowns, met = solve(p.tolist(), force, (*at.base_moment_nmm, 0.0), *ANYWHERE)
        assert at.stable
        assert met
        assert found == pytest.approx(at.tip_mm, abs=5e-3)  # [mm]; the model's own discretisation
        # Its base moment leaves no moment at the tip in yet another formulation (quaternions, DOP853).
        again, left = shoot(model.setup.rod, p, np.array(force), np.array(unknowns[:3]))
        assert found == pytest.approx(again.tolist(), abs=1e-4)
        assert np.abs(left).max() < 1e-3


def test_the_arm_is_that_of_the_study_of_the_paper_also_with_errors():
    robot = arm_with("errors: {modulus_percent: [4, -3], moment_percent: -2}")
    assert robot.sim.errors.modulus_percent == (4.0, -3.0)
    solve = arm_solver(robot)
    nominal = CosseratModel(robot).setup.rod
    from studies.shi_experiments import Plant, arm

    rod = Plant().rod((0, 1))
    assert arm((0, 1)) == nominal
    force = np.array([0.0, 0.0, 0.05])
    p = pressures(4)
    study = forward(rod, p, force, STEPS)
    for row, tip in zip(p, study.tip, strict=True):
        found = solve(row.tolist(), force.tolist(), (0.0,) * 4, *ANYWHERE)
        assert found.found
        assert found.tip_mm == pytest.approx(tip.tolist(), abs=1e-6)
        assert found.unknowns[3] == 0.0


def test_a_push_of_the_wall_is_a_force_on_a_free_tip():
    """The same equilibrium without the wall, and by shooting in another formulation."""
    robot = arm_with()
    solve, rod = arm_solver(robot), CosseratModel(robot).setup.rod
    normal = (0.6, 0.0, 0.8)
    for p in pressures(4):
        free = solve(p.tolist(), (0.0, 0.01, 0.02), (0.0,) * 4, *ANYWHERE)
        wall = float(np.dot(normal, free.tip_mm)) - 2.0
        held = solve(p.tolist(), (0.0, 0.01, 0.02), free.unknowns, True, normal, wall)
        assert held.found
        assert np.dot(normal, held.tip_mm) == pytest.approx(wall, abs=1e-8)
        push = held.unknowns[3]
        assert push < -1e-3  # it pulls the tip back
        load = (0.6 * push, 0.01, 0.02 + 0.8 * push)
        again = solve(p.tolist(), load, (*held.unknowns[:3], 5.0), *ANYWHERE)
        assert again.found
        assert again.tip_mm == pytest.approx(held.tip_mm, abs=1e-6)
        tip, left = shoot(rod, p, np.array(load), np.array(held.unknowns[:3]))
        assert held.tip_mm == pytest.approx(tip.tolist(), abs=1e-4)
        assert np.abs(left).max() < 1e-3


def test_beyond_its_range_the_modulus_stays_and_a_missing_equilibrium_is_reported():
    robot = arm_with()
    sections = [section_constants(s, 1.0, 1.0) for s in robot.geometry.sections]
    ends = [(*row[:17], up_to) for row in sections for up_to in (0.5,)]
    kernel = load("plant").Arm(ends, STEPS)
    clamped = [(*row[:12], 0.0, 0.0, 0.0, 0.0, float(np.polyval(row[12:17], 0.5)), 9.0) for row in sections]
    fixed = load("plant").Arm(clamped, STEPS)
    p = [0.8] * 3 + [0.7] * 3
    given_to = (p, (0.0, 0.0, 0.01), (0.0,) * 4, *ANYWHERE)
    assert kernel.solve(*given_to).tip_mm == pytest.approx(fixed.solve(*given_to).tip_mm, abs=1e-9)
    assert not kernel.solve(p, (0.0, np.nan, 0.0), (0.0,) * 4, *ANYWHERE).found


def test_wrong_numbers_of_the_arm_are_refused():
    row = section_constants(arm_with().geometry.sections[0], 1.0, 1.0)
    with pytest.raises(ValueError, match="18 numbers"):
        load("plant").Arm([row[:17]], STEPS)
    arm = load("plant").Arm([row], STEPS)
    right = [(0.1,) * 3, (0.0,) * 3, (0.0,) * 4, False, (0.0,) * 3, 0.0]
    assert arm.solve(*right).found
    for place, message in (
        (0, "pressures: three"),
        (1, "force: three"),
        (2, "guess: four"),
        (4, "normal: three"),
    ):
        wrong = [*right]
        wrong[place] = (0.0,) * 2
        with pytest.raises(ValueError, match=message):
            arm.solve(*wrong)


def test_a_wall_stops_the_tip_and_pushes_only_away():
    # The free tip of these pressures would be beyond the wall; then they fall, and it leaves it.
    wall = "payload_g: 3\nwall: {point_mm: [12, 0, 0], normal: [-2, 0, 0]}"
    body, free = SimulatedBody(arm_with(wall)), SimulatedBody(arm_with("payload_g: 3"))
    pushes = []
    for share in np.linspace(0.0, 1.0, 15).tolist() + np.linspace(1.0, 0.0, 15).tolist():
        p = [1e5 * share * v for v in (0.5, 0.1, 0.1, 0.6, 0.1, 0.1)]
        p = p if free_is_positive(p) else [p[1], p[0], p[0], p[4], p[3], p[3]]
        for each in (body, free):
            each.follow(p)
        x, y, z = body.tip_in_world_m(1.0)
        x_free = free.tip_in_world_m(1.0)[0]
        pushes.append(body.push_n)
        assert not body.lost
        assert x <= 0.012 + 1e-9
        if body.push_n > 0.0:
            assert x == pytest.approx(0.012, abs=1e-9)
            assert x_free > 0.012
            # Held against the model with the push as a load.
            load = (-body.push_n, 0.0, 3e-3 * 9.80665)
            assert CosseratModel(arm_with()).forward(tuple(p), load).tip_m == pytest.approx(
                (x, y, z), abs=5e-6
            )
        else:
            assert x == pytest.approx(x_free, abs=1e-9)
    assert max(pushes) > 5e-3
    assert pushes[0] == pushes[-1] == 0.0


def free_is_positive(p):
    """Whether these pressures bend the arm to +x."""
    return CosseratModel(arm_with()).forward(tuple(p)).tip_m[0] >= 0.0


def test_play_and_offsets_act_on_the_pressures():
    sharp = SimulatedBody(arm_with())
    loose = SimulatedBody(arm_with("errors: {hysteresis_bar: 0.03}"))
    off = SimulatedBody(arm_with("errors: {regulator_bar: 0.03, seed: 4}"))
    tips = {}
    for name, levels in (("up", (0.0, 0.5)), ("down", (0.0, 0.8, 0.5))):
        for body in (sharp, loose, off):
            for level in levels:
                body.follow([1e5 * level, 0.0, 0.0, 0.0, 0.0, 0.0])
            tips[name, body] = np.array(body.tip_in_world_m(0.0))
    assert tips["up", sharp] == pytest.approx(tips["down", sharp], abs=1e-9)
    low, high = (
        CosseratModel(arm_with()).forward((1e5 * level, *(0.0,) * 5)).tip_m for level in (0.485, 0.515)
    )
    assert tips["up", loose] == pytest.approx(low, abs=5e-6)
    assert tips["down", loose] == pytest.approx(high, abs=5e-6)
    assert np.linalg.norm(tips["up", off] - tips["up", sharp]) > 1e-4


def tracked(keys, seconds, rate_hz=500.0):
    """Measurements of a bus at rest, by arrival [s]."""
    clock = VirtualClock(100.0)
    bus = open_buses(with_mock(parse_robot_file(text_with(keys), "arm.yaml")), clock)["regulators"]
    assert isinstance(bus, MeasuresTips)
    out = []
    for tick in range(round(seconds * rate_hz)):
        clock.set(100.0 + tick / rate_hz)
        bus.exchange({})
        out += [(clock.now(), tip) for tip in bus.measured_tips()]
    bus.close()
    return out


def test_the_tracker_has_its_rate_latency_noise_and_hidden_intervals():
    keys = "payload_g: 10\npayload_at_s: 5\npayload_until_s: 8"
    found = tracked(keys + "\ntracker: {hidden_s: [[2, 3]], latency_ms: 25, noise_mm: 0.3}", 10.0)
    assert len(found) == pytest.approx(450, abs=2)
    assert all(at - tip.time_s == pytest.approx(0.026, abs=0.0021) for at, tip in found)
    captures = np.array([tip.time_s for _, tip in found]) - 100.0
    assert not ((captures > 1.99) & (captures < 2.99)).any()
    assert np.diff(captures).min() == pytest.approx(0.02, abs=1e-9)
    tips = np.array([tip.tip_in_world_m for _, tip in found])
    loaded = (captures >= 5.0) & (captures < 8.0)
    for chosen, force in ((loaded, 0.0980665), (~loaded, 0.0)):
        truth = CosseratModel(arm_with()).forward((0.0,) * 6, (0.0, 0.0, force)).tip_m
        assert tips[chosen].mean(axis=0) == pytest.approx(truth, abs=1e-4)
        assert tips[chosen].std(axis=0) == pytest.approx([3e-4] * 3, rel=0.25)
    assert [tip for _, tip in tracked(keys, 1.0)] == [tip for _, tip in tracked(keys, 1.0)]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("payload_g: -1", "payload_g"),
        ("payload_kg: 1", "payload_kg"),
        ("payload_at_s: 5\npayload_until_s: 4", "payload_until_s 4 is not after payload_at_s 5"),
        ("wall: {point_mm: [0, 0, 0], normal: [0, 0, 0]}", "normal"),
        ("errors: {modulus_percent: [1, 2, 3]}", "3 numbers for 2 sections"),
        ("tracker: {rate_hz: 0}", "rate_hz"),
        ("tracker: {hidden_s: [[3, 2]]}", "hidden_s"),
    ],
)
def test_mistakes_are_located(keys, message):
    with pytest.raises(BadInputError, match=message) as caught:
        parse_robot_file(text_with(keys), "arm.yaml")
    assert "arm.yaml:" in str(caught.value)


@pytest.mark.process
def test_a_run_records_the_payload_and_replays(tmp_path: Path):
    (tmp_path / "arm.yaml").write_text(
        text_with("payload_g: 5\npayload_at_s: 1.5\nerrors: {regulator_bar: 0.03}")
    )
    (tmp_path / "rest.csv").write_text(
        "t_s,"
        + ",".join(f"s{i}.p{k}_bar" for i in (1, 2) for k in (1, 2, 3))
        + "\n0,.5,.1,.1,.6,.1,.1\n2,.5,.1,.1,.6,.1,.1\n"
    )
    contid = [sys.executable, "-m", "contid"]
    run = [
        *contid,
        "run",
        "arm.yaml",
        "--virtual",
        "--rate",
        "100",
        "--trajectory",
        "rest.csv",
        "--record",
        "a.mcap",
    ]
    for command in (run, [*contid, "replay", "a.mcap"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=200)
        assert done.returncode == 0, done.stderr
    from contid import Session

    rows = list(Session(tmp_path / "a.mcap"))
    tips = np.array([[row[f"sample.arm.meas.{axis}_mm"] for axis in "xyz"] for row in rows])
    t = np.array([row["t_s"] for row in rows])
    before, after = (np.nanmean(tips[(t > a) & (t < a + 0.3)], axis=0) for a in (1.2, 1.6))
    assert np.linalg.norm(after - before) > 5.0  # the weight pulls the bent arm straight [mm]
