"""The guard of the tick: whatever moves a robot, it stops before it comes too near."""

import io
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from contid.control.engine import messages as msg
from contid.control.engine.events.robots import FaultLatched, GotoEnded, OrderRefused
from contid.control.engine.virtual import VirtualProcess, run_virtual
from contid.control.engine.wiring import build_robot_configs, record_layout
from contid.control.tick.supervisor import Mode
from contid.robot_file.base import StopPolicy
from contid.robot_file.load import parse_robot_file, with_mock
from contid.targets import Target
from contid.trajectory.read import read_trajectory
from contid.trajectory.straight_stop import StraightStop
from tests.campaign.script import close_hand
from tests.clearance.finger_file import FINGER, WALL

TIP_FREE_M = 0.022
#: Of the check, and of dense samples.
TOLERANCE_M = 1.5e-4


class Kept:
    """A sink that keeps records and events."""

    def __init__(self, loaded):
        self.loaded = loaded
        self.layout = record_layout(loaded, loaded.file.rate_hz)
        self.configs = build_robot_configs(loaded, loaded.file.rate_hz)
        self.records, self.events = [], []

    def write(self, values):
        self.records.append(self.layout.decode(tuple(values)))

    def event(self, event):
        self.events.append(event)

    def of(self, kind):
        return [event for event in self.events if isinstance(event, kind)]

    def commands(self, robot):
        """Commanded actuations of the ticks that commanded one."""
        axes = [record.robots[robot].axes for record in self.records]
        return [tuple(axis.command for axis in each) for each in axes if not np.isnan(each[0].device)]

    def curve(self, robot, command, cut_m=0.0):
        """401 points of the backbone in the world, by the model."""
        config = self.configs[robot]
        points = config.model.shape(command, 401)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        s = np.concatenate([[0.0], np.cumsum(steps)])
        rotation = np.array(config.frame.rotation).reshape(3, 3)
        return (points @ rotation.T + config.frame.origin_in_world)[s <= s[-1] - cut_m]


@pytest.mark.slow
def test_random_targets_never_bring_the_fingers_of_a_close_hand_together():
    """Rows go to the engine unchecked, at random instants, also while the robots move."""
    loaded = with_mock(close_hand())
    kept, rng = Kept(loaded), np.random.default_rng(3)
    process = VirtualProcess(loaded, 200.0, kept, attended=True)
    process.engine.arm()
    for tick in range(1300):
        process.begin()
        if tick > 100 and rng.random() < 0.02:
            middle, bend = rng.uniform(0.03, 0.08, 2), rng.uniform(-0.02, 0.02, 2)
            ends = np.stack([middle - bend, middle + bend], axis=1)
            rows = {
                name: Target(actuation=tuple(np.clip(each, 0.0, 0.1).tolist()))
                for name, each in zip(("left", "right"), ends, strict=True)
            }
            process.engine.obey(msg.Rows(rows), tick)
        process.turn()
    process.close()
    left, right = kept.commands(0), kept.commands(1)
    assert len(left) == len(right)
    least = min(
        cKDTree(kept.curve(0, a, TIP_FREE_M)).query(kept.curve(1, b, TIP_FREE_M))[0].min()
        for a, b in zip(left[::3], right[::3], strict=True)
    )
    assert least - 0.014 >= 2e-3 - TOLERANCE_M
    # Stops with limited jerk begin earlier than the margin of 2 mm alone asks for.
    assert least - 0.014 < 12e-3, "nothing came near"
    assert len(kept.of(OrderRefused)) > 3
    assert not kept.of(FaultLatched)


def of_wall(kept):
    """Least distance of the finger's surface from the wall at x = 40 mm."""
    return min(float((0.04 - kept.curve(0, c)[:, 0]).min()) for c in kept.commands(0)) - 0.007


FEEDBACK = "    feedback: {gain_per_s: 4, limit_mm: 20, stale_ms: 500, fade_ms: 200}\n    axes:"
#: A tip that goes 20 mm aside and seems to hang back by 15 mm.
HANGING = "t_s,x_mm,y_mm,meas.x_mm,meas.y_mm\n" + "".join(
    f"{t / 10:g},{min(t, 20):g},75,{min(t, 20) - 15:g},75\n" for t in range(61)
)


def with_feedback():
    return FINGER.replace("OBSTACLE", WALL).replace("    axes:", FEEDBACK)


def test_a_correction_of_tip_feedback_into_a_wall_is_fault_303():
    loaded = with_mock(parse_robot_file(with_feedback(), "f.yaml"))
    kept = Kept(loaded)
    path = read_trajectory(io.StringIO(HANGING), "t.csv", loaded.driven)
    report = run_virtual(loaded, 100.0, path, sinks=[kept])
    (fault,) = kept.of(FaultLatched)
    assert fault.fault == 303
    assert "of wall; clearance.margin_mm is 1" in fault.message
    assert report.exit_code == 3
    assert 1e-3 - TOLERANCE_M <= of_wall(kept) < 2e-3


def test_a_goto_into_a_wall_holds_before_it_and_has_not_arrived():
    loaded = with_mock(parse_robot_file(FINGER.replace("OBSTACLE", WALL), "f.yaml"))
    kept = Kept(loaded)
    process = VirtualProcess(loaded, 100.0, kept, attended=True)
    process.engine.arm()
    for tick in range(300):
        process.begin()
        if tick == 50:
            process.engine.obey(msg.Goto("f", Target(actuation=(0.045, 0.075))), tick)
        process.turn()
    assert process.engine.robots.states[0].mode is Mode.HOLD
    process.close()
    assert [event.arrived for event in kept.of(GotoEnded)] == [False]
    (refused,) = kept.of(OrderRefused)
    assert refused.robot == "f"
    assert "before it can stop, f at" in refused.message
    assert 1e-3 - TOLERANCE_M <= of_wall(kept) < 3e-3


def test_a_stop_through_the_rest_pose_ends_in_front_of_the_other_finger():
    """The left finger bent away, then the right one bent to where the left one rests."""
    loaded = with_mock(close_hand())
    kept = Kept(loaded)
    process = VirtualProcess(loaded, 200.0, kept, attended=True)
    process.engine.arm()
    way = {
        100: msg.Goto("left", Target(actuation=(0.075, 0.045))),
        350: msg.Goto("right", Target(actuation=(0.068, 0.092))),
        700: msg.Stop(("left",), StopPolicy.REST, "on_end"),
    }
    for tick in range(1000):
        process.begin()
        if tick in way:
            process.engine.obey(way[tick], tick)
        process.turn()
    assert [state.mode for state in process.engine.robots.states] == [Mode.OFF, Mode.HOLD]
    process.close()
    assert [event.arrived for event in kept.of(GotoEnded)] == [True, True]
    (refused,) = kept.of(OrderRefused)
    assert "it stops where it is instead of at its rest pose" in refused.message
    last = kept.commands(0)[-1], kept.commands(1)[-1]
    shafts = [kept.curve(index, command, TIP_FREE_M) for index, command in enumerate(last)]
    whole = [kept.curve(index, command) for index, command in enumerate(last)]
    apart_m = min(cKDTree(whole[i]).query(shafts[1 - i])[0].min() for i in (0, 1))
    assert 2e-3 - TOLERANCE_M <= apart_m - 0.014 < 5e-3


@pytest.mark.process
def test_a_run_that_the_guard_ended_replays_equal(tmp_path):
    (tmp_path / "f.yaml").write_text(with_feedback())
    (tmp_path / "t.csv").write_text(HANGING)
    command = [sys.executable, "-m", "contid"]
    run = [*command, "run", "f.yaml", "--mock", "--trajectory", "t.csv", "--record", "s.mcap"]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 3, done.stderr
    assert "fault 303 too-near: " in done.stderr
    replay = [*command, "replay", "s.mcap"]
    again = subprocess.run(replay, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert again.returncode == 0, again.stdout + again.stderr


@given(st.lists(st.floats(-3e-4, 3e-4), min_size=1, max_size=4), st.floats(1e-6, 1e-3), st.integers(0, 400))
def test_a_straight_stop_keeps_its_limits_and_can_be_begun_again(steps, change, after):
    """Tick by tick against the sum of its steps; begun again on the way it ends no later and no further."""
    ends, changes, position = [(-1.0, 1.0)] * len(steps), [change] * len(steps), (0.0,) * len(steps)
    stop = StraightStop(position, tuple(steps), changes, ends, 0.01)
    last, step = np.zeros(len(steps)), np.array(steps)
    ticks = round(stop.duration_s / 0.01)
    for k in range(1, ticks + 2):
        now = np.array(stop.at(0.01 * k)[0])
        assert np.all(np.abs(now - last - step) <= change * (1.0 + 1e-6) + 1e-15)
        last, step = now, now - last
        if k == min(after, ticks):
            again = StraightStop(tuple(now.tolist()), tuple(step.tolist()), changes, ends, 0.01)
            assert again.duration_s <= stop.duration_s - 0.01 * k + 1e-9
            assert np.all(np.array(again.distances) <= np.abs(np.array(stop.at(1e9)[0]) - now) + 1e-12)
    assert np.allclose(np.abs(last), stop.distances, atol=1e-12)
    assert np.allclose(step, 0.0, atol=1e-15)
