"""Placing, gates and clocks of measured tips, without a network."""

import math

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from contid.errors import BadInputError, ContidError
from contid_mocap.placing import MOVED_FRAMES, fitted
from contid_mocap.room import RoomFrame, RoomPose
from contid_mocap.setup_file import MocapSetup, read_setup
from contid_mocap.tip_tracker import RESTARTED, RoomTipTracker
from tests.support.mocap.rooms import setup_file


def setup(room=None, **keys):
    tip = {"arm": {"body": "tip", "z_mm": 30, "pitch_deg": 90}}
    return MocapSetup(**{"contid_mocap": 1, "room": room or {"up": "z"}, "robots": tip, **keys})


def pose(position=(0.1, 0.2, 0.3), turn=(0.0, 0.0, 0.0)):
    return RoomPose(position, Rotation.from_euler("xyz", turn, degrees=True).as_matrix())


def frame(number=1, time_s=100.0, received_s=None, **poses):
    return RoomFrame(number, time_s, time_s if received_s is None else received_s, poses or {"tip": pose()})


def look(tracker, seen, now_s=None):
    (found,) = tracker.look(seen, seen.received_s if now_s is None else now_s)
    return found


def test_a_tip_is_placed_as_homogeneous_matrices_place_it():
    room = {"x_mm": 120, "y_mm": -40, "z_mm": 10, "roll_deg": 20, "pitch_deg": -30, "yaw_deg": 70, "up": "y"}
    tracker = RoomTipTracker(setup(room))
    seen = pose((0.4, 1.1, -0.3), (10, 80, -35))
    tip = look(tracker, frame(tip=seen)).tip

    def motion(turn, shift):
        made = np.eye(4)
        made[:3, :3], made[:3, 3] = turn, shift
        return made

    up = Rotation.from_euler("x", 90, degrees=True).as_matrix()  # y of the room becomes z
    placed = motion(
        Rotation.from_euler("ZYX", [70, -30, 20], degrees=True).as_matrix() @ up, [0.12, -0.04, 0.01]
    )
    in_body = motion(Rotation.from_euler("y", 90, degrees=True).as_matrix(), [0.0, 0.0, 0.03])
    expected = placed @ motion(seen.rotation, seen.position_m) @ in_body
    assert tip.tip_m == pytest.approx(expected[:3, 3])
    assert tip.direction == pytest.approx(expected[:3, 2])
    assert tip.robot == "arm"


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_the_axis_that_is_up_becomes_z_without_a_mirror(up):
    tracker = RoomTipTracker(setup({"up": up}, robots={"arm": {"marker": "set:m"}}))
    axes = []
    for k in range(3):
        unit = (float(k == 0), float(k == 1), float(k == 2))
        tip = look(tracker, frame(k + 1, 100.0 + 10 * k, **{"set:m": RoomPose(unit, None)})).tip
        assert tip.direction is None
        axes.append(tip.tip_m)
    turn = np.array(axes).T
    assert np.linalg.det(turn) == pytest.approx(1.0)
    sign, axis = (-1.0, up[1]) if up.startswith("-") else (1.0, up)
    assert turn[:, "xyz".index(axis)] == pytest.approx([0.0, 0.0, sign])


def test_known_points_are_fitted_as_scipy_aligns_them():
    rng = np.random.default_rng(3)
    room = rng.uniform(-1, 1, (6, 3))
    turn = Rotation.from_euler("xyz", [30, 200, -50], degrees=True)
    world = turn.apply(room) + np.array([0.3, -1.0, 2.0]) + rng.normal(0, 2e-4, (6, 3))
    found = fitted(np.hstack([room, world]), 1.0)
    expected, _ = Rotation.align_vectors(world - world.mean(0), room - room.mean(0))
    assert found.turn == pytest.approx(expected.as_matrix(), abs=1e-9)
    assert found.shift == pytest.approx([0.3, -1.0, 2.0], abs=1e-3)
    with pytest.raises(ContidError, match=r"fit with .* mm rms only; room.within_mm is 0.01"):
        fitted(np.hstack([room, world]), 0.01)
    mirrored = np.hstack([room, world * [1, 1, -1]])
    with pytest.raises(ContidError, match="mm rms only"):
        fitted(mirrored, 2.0)
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(ContidError, match="lie on a line"):
        fitted(np.hstack([line, line]), 2.0)


def test_a_body_on_the_base_carries_the_room():
    """Where the origin of the room is does not matter; a base that moves is refused, then counts anew."""
    tracker = RoomTipTracker(setup({"base": {"body": "plate", "x_mm": 50, "yaw_deg": 90}}))
    assert "on the base was not seen yet" in look(tracker, frame(1)).refusal
    rng = np.random.default_rng(1)
    base, tip = pose((1.0, 2.0, 0.5), (40, 10, 70)), pose((1.1, 2.0, 0.6), (40, 10, 70))
    for k in range(2, 60):
        x, y, z = (np.array(base.position_m) + rng.normal(0, 1e-4, 3)).tolist()
        noisy = RoomPose((x, y, z), base.rotation)
        found = look(tracker, frame(k, 100.0 + 0.01 * k, plate=noisy, tip=tip))
    inner = np.asarray(base.rotation).T @ (
        np.array([0.1, 0.0, 0.1]) + np.asarray(base.rotation) @ [0, 0, 0.03]
    )
    expected = [0.05, 0, 0] + Rotation.from_euler("z", 90, degrees=True).as_matrix() @ inner
    assert found.tip.tip_m == pytest.approx(expected, abs=1e-4)
    for k in range(60, 60 + MOVED_FRAMES - 1):
        moved = pose((1.02, 2.0, 0.5), (40, 10, 70))
        found = look(tracker, frame(k, 100.0 + 0.01 * k, plate=moved, tip=tip))
        assert found.refusal == "the body 'plate' on the base has moved"
    assert look(tracker, frame(90, 110.0, plate=moved, tip=tip)).tip is not None


def test_a_base_that_turns_about_its_body_has_moved():
    """Its marker plate stays where it is, and every tip would be off by its distance times the angle."""
    tracker = RoomTipTracker(setup({"base": {"body": "plate"}}))
    rng = np.random.default_rng(2)
    tip = pose((0.4, 0.2, 0.3))
    for k in range(1, 40):
        x, y, z = rng.normal(0.0, 0.2, 3).tolist()  # noise of a small plate [deg]
        noisy = frame(k, 100.0 + 0.01 * k, plate=pose(turn=(x, y, z)), tip=tip)
        assert look(tracker, noisy).tip is not None
    for k in range(40, 40 + MOVED_FRAMES - 1):
        found = look(tracker, frame(k, 100.0 + 0.01 * k, plate=pose(turn=(0, 0, 4)), tip=tip))
        assert found.refusal == "the body 'plate' on the base has moved"
    found = look(tracker, frame(90, 110.0, plate=pose(turn=(0, 0, 4)), tip=tip))
    seen = Rotation.from_euler("z", 4, degrees=True).as_matrix().T @ [0.3, 0.0, 0.0]
    assert found.tip.tip_m[:2] == pytest.approx(seen[:2], abs=1e-9)


def test_a_base_that_has_moved_is_refused_also_in_frames_without_it():
    """It may be lost after a blow, and Vicon sends base and tip in different packets of a frame."""
    tracker = RoomTipTracker(setup({"base": {"body": "plate"}}))
    assert look(tracker, frame(1, plate=pose(), tip=pose())).tip is not None
    moved = pose((0.11, 0.2, 0.3))
    for k, poses in enumerate(({"plate": moved}, {}, {"plate": None}), start=2):
        found = look(tracker, frame(k, 100.0 + 0.01 * k, tip=pose(), **poses))
        assert found.refusal == "the body 'plate' on the base has moved"
    assert look(tracker, frame(5, 100.05, plate=pose(), tip=pose())).tip is not None
    assert look(tracker, frame(6, 100.06, tip=pose())).tip is not None


def test_a_body_that_is_lost_gives_no_tip_and_the_next_pose_must_follow_the_last():
    tracker = RoomTipTracker(setup(gate={"lost": 5}))
    assert look(tracker, frame(1)).tip is not None
    assert look(tracker, frame(2, 100.01, tip=None)).refusal == "'tip' is not tracked"
    far = pose((0.1, 0.7, 0.3))
    refused = [look(tracker, frame(k, 100.0 + 0.01 * k, tip=far)) for k in range(3, 7)]
    assert all("the tip jumps by 500.0 mm" in each.refusal for each in refused)
    assert look(tracker, frame(7, 100.07, tip=far)).tip is not None
    assert look(tracker, frame(8, 100.08)).tip is None
    turned = pose((0.1, 0.7, 0.3), (0, 0, 90))
    assert "turns by 90 degrees at once" in look(tracker, frame(9, 100.09, tip=turned)).refusal


def test_stale_repeated_late_and_future_poses_are_never_taken():
    tracker = RoomTipTracker(setup())
    assert look(tracker, frame(10)).tip is not None
    assert look(tracker, frame(10, 100.001)).refusal == "a frame comes twice"
    assert look(tracker, frame(9, 100.002)).refusal == "a frame comes after a later one"
    assert look(tracker, frame(11, 100.01), now_s=100.2).refusal == "the pose is 190 ms old"
    assert look(tracker, frame(12, 100.3, 100.2)).refusal == "the pose is from 100 ms ahead"
    assert look(tracker, frame(13, math.nan, 100.3)).refusal == "the clock of the server is not known yet"
    assert look(tracker, frame(14, 99.999)).refusal == "the pose is older than the last"
    # Within the bound of the clock a capture counts as its arrival.
    assert look(tracker, frame(15, 100.303, 100.3)).tip.time_s == 100.3


def test_of_many_frames_in_disorder_no_stale_one_is_taken():
    """Ages, orders and clocks at random: what is taken is at most 100 ms old, and newer than all before."""
    rng = np.random.default_rng(52)
    tracker, now_s, newest_s, taken = RoomTipTracker(setup()), 100.0, -math.inf, 0
    for number in range(5000):
        now_s += rng.exponential(1 / 240)
        age_s = rng.choice(
            [rng.exponential(0.003), rng.exponential(0.2), -rng.exponential(0.01)], p=[0.8, 0.15, 0.05]
        )
        late = int(rng.integers(1, 4)) if rng.random() < 0.1 else 0
        found = look(tracker, frame(number - late, now_s - age_s, now_s - rng.exponential(1e-4)), now_s)
        if found.tip is None:
            continue
        taken += 1
        assert 0.0 <= now_s - found.tip.time_s <= 0.1
        assert found.tip.time_s > newest_s
        newest_s = found.tip.time_s
    assert taken > 1000


def test_missing_frames_are_counted_through_the_wrap_of_the_number():
    tracker = RoomTipTracker(setup())
    look(tracker, frame(2**32 - 2))
    assert look(tracker, frame(2**32 - 1, 100.01)).missing == 0
    assert look(tracker, frame(3, 100.02)).missing == 3
    assert look(tracker, frame(4, 100.03)).missing == 0


def test_a_server_that_starts_again_is_followed_after_some_frames():
    tracker = RoomTipTracker(setup())
    assert look(tracker, frame(100_000)).tip is not None
    looks = [look(tracker, frame(k, 101.0 + 0.01 * k)) for k in range(RESTARTED + 2)]
    assert [each.restarted for each in looks] == [False] * (RESTARTED - 1) + [True, False, False]
    assert all(each.tip is None for each in looks[:RESTARTED])
    assert looks[-1].tip is not None


def test_an_unknown_robot_is_refused_with_the_names_there_are():
    with pytest.raises(ContidError, match="no robot 'arn'; allowed: arm; did you mean 'arm'"):
        RoomTipTracker(setup(), ["arn"])


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"room": {"fit": [[0] * 6] * 3, "x_mm": 1}}, "found a pose and fit"),
        ({"room": {}}, "found none"),
        ({"room": {"fit": [[0] * 6] * 2}}, "fit: allowed is at least 3 items"),
        ({"robots": {"arm": {"body": "a", "marker": "b:c"}}}, "give `body` or `marker`"),
        ({"robots": {"arm": {"marker": "b:c", "z_mm": 3}}}, "a marker is the tip itself"),
        ({"robots": {}}, "robots"),
        ({"contid_mocap": 2}, "contid_mocap"),
        ({"room": {"up": "w"}}, "is not possible; allowed: x, y, z, -x, -y, -z"),
        ({"gate": {"speed": 3}}, "unknown key 'speed'"),
    ],
)
def test_mistakes_in_the_setup_have_their_place(tmp_path, change, expected):
    right = {"contid_mocap": 1, "room": {"up": "y"}, "robots": {"arm": {"body": "tip"}}}
    path = setup_file(tmp_path, yaml.safe_dump({**right, **change}))
    with pytest.raises(BadInputError) as refused:
        read_setup(path)
    assert expected in str(refused.value)
    assert "mocap.yaml:" in str(refused.value)
