"""Contacts of the tip on the simulated arm: the detector, its event, and the policies of a robot file."""

import math

import numpy as np
import pytest

from contid import Session, kernels
from contid.control.engine.events.robots import ContactBegan
from contid.errors import BadInputError
from contid.robot_file.load import load_robot_file, parse_robot_file
from contid_fit.sense.live.innovation_test import GATE, NEWEST, REFERENCE, InnovationTest, TipResidual
from tests.sense.calibrated_arm import RATE_HZ, calibrated_arm
from tests.sense.commands import contid
from tests.sense.contact_runs import ContactRun, push, spiral, with_wall
from tests.sense.observed import calibrated, plant

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(kernels.load("cosserat") is None, reason="NumPy takes minutes"),
]

NO_LOAD = np.zeros((3, 3))
SLOPES = np.full((3, 6), 50.0)


def residual(missed, velocity=(0.0, 0.0, 0.0)):
    return TipResidual(np.array(missed), np.array(velocity), SLOPES, 1e-4 * np.eye(3), np.eye(3), NO_LOAD)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 2])
def test_a_wall_is_found_and_its_direction(seed):
    found = push(seed)
    assert found is not None
    assert found.early == 0
    assert 0.0 < found.found_s - found.touch_s < 0.4
    assert found.angle_deg < 60.0
    assert found.force_n == pytest.approx(found.push_n, rel=0.7)


@pytest.mark.parametrize("minutes", [0.2, pytest.param(0.5, marks=pytest.mark.campaign)])
def test_a_spiral_has_no_contact(minutes):
    contacts, largest, looked = spiral(1, minutes)
    assert contacts == []
    assert largest < GATE
    assert looked > 0.9


def test_the_end_of_a_contact_is_no_contact_and_the_next_one_is():
    rng = np.random.default_rng(7)
    robot, free, pushed = calibrated(plant(), rng), (0.0, 0.0, 0.0), (0.04, 0.0, 0.0)
    run = ContactRun(robot, plant(), rng)
    run.begin(np.full(6, 0.5))
    for force, contacts in ((pushed, 1), (free, 1), (pushed, 2)):
        assert run.contact.armed
        run.body.force = force
        run.rest(2.4)
        assert len(run.contacts) == contacts
    for _, found in run.contacts:
        assert found.direction_in_base[0] > 0.9
        assert found.force_n == pytest.approx(pushed[0], rel=0.5)
    # The velocity of the pressures is that over the newest three measurements.
    run.contact._poses.clear()
    rates = [run.contact._rate(0.02 * k, 0.1 * k**2 * np.ones(6))[0] for k in range(4)]
    assert rates == pytest.approx([0.0, 0.1 / 0.02, 0.4 / 0.04, (0.9 - 0.1) / 0.04])


def test_noise_alone_stays_inside_and_a_step_leaves():
    rng = np.random.default_rng(1)
    test = InnovationTest(0.3)
    for _ in range(5000):
        assert test.add(residual(rng.normal(0.0, 0.3, 3))) is None
    # The gate is in units of the noise: 0.3 mm and that of pressures, which was learned to be none.
    steps = [test.add(residual(np.array([3.0, 0.0, 0.0]) + rng.normal(0.0, 0.3, 3))) for _ in range(3)]
    found = next(each for each in steps if each is not None)
    assert found.squared_distance > GATE
    assert found.shift_mm == pytest.approx([3.0, 0.0, 0.0], abs=1.2)
    assert 0.9 < found.confidence <= 1.0


def test_a_late_tip_is_a_lag_and_no_contact():
    rng = np.random.default_rng(2)
    test = InnovationTest(0.3)
    for k in range(2000):
        velocity = np.array([80.0 * math.sin(2.0 * math.pi * k / 150.0), 0.0, 0.0])
        late = np.array([80.0 * math.sin(2.0 * math.pi * (k - 1) / 150.0), 0.0, 0.0])
        assert test.add(residual(0.006 * velocity + rng.normal(0.0, 0.3, 3), late)) is None
    assert test.lag_s == pytest.approx(0.006, abs=0.001)


def test_it_looks_only_once_it_has_a_pattern():
    test = InnovationTest(0.3)
    for _ in range(NEWEST + REFERENCE - 1):
        assert not test.armed
        test.add(residual([0.0, 0.0, 0.0]))
    test.add(residual([0.0, 0.0, 0.0]))
    assert test.armed


AXES = [f"s{i}.p{j}_bar" for i in (1, 2) for j in (1, 2, 3)]
LOW, HIGH = np.full(6, 0.3), np.array([1.0, 0.2, 0.2, 1.0, 0.2, 0.2])


def into_the_wall(path):
    """Through the loops of the axes, a rest, then a bend for 4 s, which lasts."""
    lines = [",".join(["t_s", *AXES])]
    for t in np.arange(0.0, 12.001, 0.05):
        s = np.clip((t - 5.0) / 4.0, 0.0, 1.0)
        shaken = 0.05 * math.sin(2.0 * math.pi * t) * min(1.0, t) * (t < 5.0)
        bar = LOW + (HIGH - LOW) * (s * s * (3.0 - 2.0 * s)) + shaken * np.array([1, -1, 1, -1, 1, -1])
        lines.append(f"{t:.3f}," + ",".join(f"{value:.4f}" for value in bar))
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Robot files with a wall that the tip meets half way, one per policy."""
    folder = calibrated_arm(tmp_path_factory, "contact")
    into_the_wall(folder / "push.csv")
    body = with_wall(np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    tips = []
    for share in np.linspace(0.0, 0.55, 12):
        body.follow((1e5 * (LOW + share * (HIGH - LOW))).tolist())
        tips.append(np.array(body.tip_in_world_m(0.0)))
    normal = (tips[0] - tips[-1]) / np.linalg.norm(tips[0] - tips[-1])
    point = ", ".join(f"{1e3 * value:.2f}" for value in tips[-1])
    wall = f"      wall: {{point_mm: [{point}], normal: {np.round(normal, 4).tolist()}}}\n"
    calibrated = (folder / "arm.yaml").read_text().replace("      errors:", wall + "      errors:", 1)
    for policy in ("ignore", "hold", "stop", "retract"):
        with_policy = calibrated.replace("      load:\n", f"      contact: {policy}\n      load:\n", 1)
        assert with_policy != calibrated
        (folder / f"{policy}.yaml").write_text(with_policy)
    return folder


def recorded(folder, policy, code=0):
    """Rows, contacts and the text of a run into the wall."""
    session = f"{policy}.mcap"
    options = ("--virtual", "--trajectory", "push.csv", "--record", session)
    run = contid(folder, "run", f"{policy}.yaml", *options, code=code)
    read = Session(folder / session)
    contacts = [event for event in read.events() if isinstance(event, ContactBegan)]
    return list(read), contacts, run.stdout + run.stderr


def bars(rows, t_s):
    row = min(rows, key=lambda each: abs(each["t_s"] - t_s))
    return np.array([row[f"command.arm.{axis.replace('.', '_')}"] for axis in AXES])


@pytest.mark.campaign
def test_ignore_writes_the_event_and_goes_on(folder):
    rows, contacts, text = recorded(folder, "ignore")
    assert len(contacts) >= 1
    first = contacts[0]
    assert (first.robot, first.policy, first.axis) == ("arm", "ignore", "")
    assert np.linalg.norm(first.direction) == pytest.approx(1.0, abs=1e-3)
    assert first.force_n > 0.0
    assert 0.9 < first.confidence <= 1.0
    assert bars(rows, 11.0) == pytest.approx(HIGH, abs=1e-6)
    assert "arm: contact: force" in text


@pytest.mark.campaign
def test_hold_stops_at_the_wall(folder):
    rows, contacts, _ = recorded(folder, "hold")
    at_s = contacts[0].tick / RATE_HZ
    there = bars(rows, at_s)
    assert bars(rows, 11.0) == pytest.approx(bars(rows, at_s + 1.0), abs=1e-9)
    assert np.abs(bars(rows, 11.0) - there).max() < 0.05
    assert there[0] < 0.85


def test_stop_latches_a_fault(folder):
    _, contacts, text = recorded(folder, "stop", code=3)
    assert contacts[0].policy == "stop"
    assert "fault 304 contact" in text


def test_retract_goes_back_the_way_it_came_and_replays(folder):
    """Of all policies it changes most: the source of motion, from events and commands of before."""
    rows, contacts, _ = recorded(folder, "retract")
    done = contid(folder, "replay", "retract.mcap")
    assert "bit for bit" in done.stdout + done.stderr
    at_s = contacts[0].time_s
    assert bars(rows, 11.0) == pytest.approx(bars(rows, at_s - 0.5), abs=0.01)
    assert np.abs(bars(rows, 11.0) - bars(rows, at_s)).max() > 0.03
    late = [row for row in rows if row["t_s"] > 10.0]
    moved = np.ptp([row["sample.arm.meas.x_mm"] for row in late])
    assert moved < 3.0  # it stands, with 0.3 mm of noise


def test_an_unknown_policy_is_refused(folder):
    text = (folder / "hold.yaml").read_text().replace("contact: hold", "contact: bounce", 1)
    with pytest.raises(BadInputError, match=r"arm.yaml:\d+.*contact.*ignore.*hold.*stop.*retract"):
        parse_robot_file(text, "arm.yaml")
    assert load_robot_file(folder / "hold.yaml")
