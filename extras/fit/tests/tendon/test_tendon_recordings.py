"""The tendon calibration on recordings of a real robot, and on invalid ones."""

from __future__ import annotations

import numpy as np
import pytest

from contid.errors import BadInputError, ContidError
from contid_fit.calibrate.tendon.geometry import find_geometry, nominal_of
from contid_fit.calibrate.tendon.recording import read_recording
from contid_fit.calibrate.tendon.stages import run_stages
from tests.calibrate.tendon_recordings import COUNT, LENGTH_M, RADIUS_M, excerpt, rows_before_pairs


def test_servos_are_assigned_to_the_sections_that_the_authors_print() -> None:
    """Their labels number the tendons: three per section, section 1 first. Two columns change places."""
    recording = excerpt()
    swapped = recording.in_order([0, 7, 2, 5, 4, 3, 6, 1, 8])
    found = find_geometry(swapped, COUNT)
    assert found is not None
    sections = {each.servo: each.section for each in found.tendons}
    printed = [4, 3, 9, 5, 2, 8, 6, 1, 7]
    assert sections == {f"servo_{servo}_mm": i // 3 for i, servo in enumerate(printed)}
    assert found.margin > 1.0
    # First angle of each section by the authors' identification [rad].
    for section, angle in enumerate((-3.06, -2.56, -2.05)):
        servo = f"servo_{printed[3 * section]}_mm"
        measured = next(each.angle_rad for each in found.tendons if each.servo == servo)
        assert abs(measured - angle) < 0.2


@pytest.mark.campaign
def test_pairs_of_sections_are_predicted_from_pulls_and_single_sections() -> None:
    """Fitted to single tendons and sections, the statics predict pairs; constant curvature does not."""
    recording = excerpt()
    found = find_geometry(recording, COUNT)
    assert found is not None
    angles = np.array([each.angle_rad for each in found.tendons])
    recording = recording.in_order(found.columns)
    split = rows_before_pairs(recording)
    training, pairs = recording.rows(0, split), recording.rows(split, len(recording))
    stages = {
        stage.name: stage
        for stage in run_stages(training, pairs, nominal_of(training, LENGTH_M, RADIUS_M, angles, COUNT))
    }
    rmse_mm = {name: 1e3 * stage.held_out.rmse_m for name, stage in stages.items() if stage.held_out}
    mean_mm = {name: 1e3 * stage.held_out.mean_m for name, stage in stages.items() if stage.held_out}
    assert rmse_mm["constant curvature"] > 12.0
    assert rmse_mm["+ friction, play"] < 7.0
    assert mean_mm["+ friction, play"] < 6.0
    last = stages["+ residual"]
    assert last.held_out is not None
    assert last.held_out.rmse_95_m[0] < last.held_out.rmse_m < last.held_out.rmse_95_m[1]
    assert 1e3 * last.train.rmse_m < 4.0


def test_without_single_pulls_there_is_no_geometry() -> None:
    recording = excerpt()
    split = rows_before_pairs(recording)
    assert find_geometry(recording.rows(split, len(recording)), COUNT) is None
    with pytest.raises(ContidError, match="pulled alone in fewer than 4 rows: servo_7_mm"):
        find_geometry(recording.rows(0, recording.pattern.index("rep1_tendon8_id7_pull")), COUNT)
    with pytest.raises(ContidError, match="9 servos, the robot has 6 tendons"):
        find_geometry(recording, (3, 3))


HEADER = "timestamp,pattern_label,servo_1_mm,servo_2_mm,servo_3_mm,tip_x,tip_y,tip_z"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("timestamp,pattern_label,servo_1_mm,tip_x,tip_y,tip_z\n", "1 columns servo_<id>_mm"),
        ("# mine\n\ntimestamp,servo_1_mm\n", "r.csv:3:1: 1 columns servo_<id>_mm"),
        (HEADER + "\n0," + "a" * 200_000 + ",0,0,0,1,2,3\n", "r.csv:2:1: not a row of a table: field larger"),
        ("a" * 200_000 + "\n", "r.csv:1:1: not a row of a table: field larger"),
        (HEADER.replace(",tip_z", "") + "\n0,a,0,0,0,1,2\n", "tip_z"),
        (HEADER + "\n0,a,0,0,nan,1,2,3\n", "r.csv:2:5: servo_3_mm: 'nan' is not a finite number"),
        (
            HEADER + "\n5,a,0,0,0,1,2,3\n4,a,0,0,0,1,2,3\n",
            "r.csv:3:1: timestamp: 4.0 is before the row above",
        ),
    ],
)
def test_a_bad_recording_is_refused_where_it_is_wrong(text: str, message: str) -> None:
    with pytest.raises(BadInputError) as caught:
        read_recording(text.splitlines(), "r.csv")
    assert message in str(caught.value)


def test_a_recording_continues_only_with_the_same_servos() -> None:
    recording = excerpt()
    with pytest.raises(BadInputError, match="its servos are not those of"):
        recording.followed_by(recording.in_order(range(8, -1, -1)))
    both = recording.rows(0, 20).followed_by(recording.rows(20, 30))
    assert both.pattern == recording.pattern[:30]
    assert np.array_equal(both.pull_m, recording.pull_m[:30])


def test_recordings_that_follow_each_other_are_runs_of_their_own() -> None:
    """Also where the last pattern of one and the first of the other have the same label."""
    one = excerpt()
    both = one.followed_by(one.rows(len(one) - 5, len(one))).followed_by(one)
    assert both.pattern[len(one) - 1] == both.pattern[len(one)]
    runs = one.runs[-1] + 1.0
    assert both.runs[-1] == 2.0 * runs
    assert np.flatnonzero(np.diff(both.runs))[[int(runs) - 1, int(runs)]].tolist() == [
        len(one) - 1,
        len(one) + 4,
    ]
    part = both.rows(len(one) - 2, len(one) + 3)
    assert part.runs.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]
