"""Recordings that are tables of other programs: from their columns to a motion file, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.robot_file.load import load_named
from contid_identify.command import command
from contid_identify.predict_command import command as predict
from contid_identify.recordings.tabled import TabledRecording, read_tabled

PSI = 6894.757
STEP_S = 0.03
MAP = """\
t_s: 0.001*ms
s1.p1_bar, s1.p2_bar, s1.p3_bar: [0.0689476*want_1_psi, 0.0689476*want_2_psi, 0.0689476*want_3_psi]
meas.s1.p1_bar: 0.0689476*got_1_psi
meas.s1.p2_bar, meas.s1.p3_bar: [0.0689476*got_2_psi, 0.0689476*got_3_psi]
meas.x_mm, meas.y_mm, meas.z_mm: [cam_x_mm - 100, cam_y_mm, 500 - cam_z_mm]
frame: {mirrored: yes}
"""
HEADER = "ms,want_1_psi,want_2_psi,want_3_psi,got_1_psi,got_2_psi,got_3_psi,cam_x_mm,cam_y_mm,cam_z_mm"


def rows(pattern: str, duration_s: float = 14.0) -> Array:
    """A pattern of 15 psi from the first row on, vented in the middle; the arm is at rest when it begins.

    One arc whose right and left chambers bend it by half a radian and lengthen it by 4 mm, as its middle one.
    """
    on = 14.0 * np.array([float(each) for each in pattern])
    at_s = np.arange(0.0, duration_s, STEP_S)
    sent = 1.0 + np.where(at_s[:, None] < 0.5 * duration_s, on, 0.0)
    first, second, out = np.ones(3), np.ones(3), []
    fine = 10
    past = [np.ones(3)] * (5 * fine)
    for k, now in enumerate(sent):
        x = (second - 1.0) / 14.0
        bend, length = 0.5 * (x[0] - x[1]), 42.0 + 4.0 * x.sum()
        chord = length if abs(bend) < 1e-9 else 2.0 * length / bend * math.sin(0.5 * bend)
        tip = chord * np.array([math.sin(0.5 * bend), 0.0, math.cos(0.5 * bend)]) + 5.0 * np.array(
            [math.sin(bend), 0.0, math.cos(bend)]
        )
        out.append([1e3 * at_s[k], *now, *second, 100.0 + tip[0], tip[1], 500.0 - tip[2]])
        for _ in range(fine):
            past.append(now)
            gap = past[-5 * fine] - first
            first = first + STEP_S / fine / np.where(gap > 0.0, 0.3, 0.9) * gap
            second = second + STEP_S / fine / 0.3 * (first - second)
    return np.array(out)


def written(folder: Path, values: Array, header: str = HEADER, name: str = "lab.csv") -> Path:
    """A table with three decimals."""
    file = folder / name
    lines = [",".join(f"{each:.3f}" for each in row) for row in values]
    file.write_text("\n".join([header, *lines]) + "\n")
    return file


def read(path: Path, text: str = MAP) -> TabledRecording:
    (robot,) = load_named("stiffflop1").driven.values()
    return read_tabled(path, "arm", robot, text, "lab.map")


def test_columns_become_set_points_and_tips(tmp_path: Path) -> None:
    values = rows("100")
    found = read(written(tmp_path, values))
    recording = found.recording
    # It begins with a step: two seconds of what was measured stand in front.
    lead = math.ceil(2.0 / recording.period_s)
    assert recording.period_s == pytest.approx(0.015)
    assert np.allclose(recording.sent[: lead - 1], PSI, rtol=1e-4)
    assert recording.sent[lead + 1] == pytest.approx([15.0 * PSI, PSI, PSI], rel=1e-4)
    assert recording.tip_at_s[0] == pytest.approx(lead * recording.period_s)
    place = 200
    at = np.searchsorted(values[:, 0], 1e3 * (recording.tip_at_s[place] - recording.tip_at_s[0]) - 1.0)
    tip = values[at, 7:] * [1.0, 1.0, -1.0] + [-100.0, 0.0, 500.0]
    assert recording.tip_m[place] == pytest.approx(1e-3 * tip, abs=1e-6)
    assert any("it begins with a step: s1.p1" in each for each in found.notes)
    # At rest of the arm the same value stands in every row: it counts every 0.1 s.
    assert len(recording.axis_at_s[1]) < 0.4 * len(values)


def test_a_frame_that_jumps_is_left_out(tmp_path: Path) -> None:
    values = rows("100")
    values[150, 7] += 15.0
    found, clean = read(written(tmp_path, values)), read(written(tmp_path, rows("100")))
    assert "1 single tips jump and were left out, the first in line 152" in found.notes
    assert len(found.recording.tip_at_s) == len(clean.recording.tip_at_s) - 1
    assert not any("jump" in each for each in clean.notes)


def test_names_of_the_robot_need_no_mapping(tmp_path: Path) -> None:
    values = rows("110")[:, [0, 1, 2, 3, 7, 8, 9]]
    values[:, 0] *= 1e-3
    values[:, 1:4] *= 0.0689476
    values[:, 4:] = values[:, 4:] * [1.0, 1.0, -1.0] + [-100.0, 0.0, 500.0]
    header = "t_s,s1.p1_bar,s1.p2_bar,s1.p3_bar,meas.x_mm,meas.y_mm,meas.z_mm"
    recording = read(written(tmp_path, values, header), "").recording
    assert recording.sent[0, 0] == pytest.approx(15.0 * PSI, rel=1e-3)
    assert recording.axis_at_s[0].size == 0
    assert recording.tip_m[0] == pytest.approx([0.0, 0.0, 0.047], abs=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (MAP, "", "lab.csv:1:1: no column 's1.p1_bar': the table is one of another program; the file has"),
        ("want_2_psi", "want_9_psi", "lab.csv:1:1: no column 'want_9_psi'.*did you mean 'want_"),
        ("s1.p2_bar", "s1.p8_bar", r"lab.map:2:\d+: no column 's1.p8_bar'"),
        ("0.0689476*want_1_psi", "1*want_1_psi", "lab.map:2:1: s1.p1_bar: 'want_1_psi' is in psi"),
        ("0.0689476*want_1_psi", "sqrt(want_1_psi*want_1_psi)", "lab.csv:2:1: s1.p1_bar is 15, but"),
        ("500 - cam_z_mm", "-900 - cam_z_mm", "lab.csv:2:1: the tip is 1353 mm from the base, but"),
        ("0.001*ms", "ms", "lab.map:1:1: "),
        ("s1.p1_bar, s1.p2_bar, s1.p3_bar: [0.0689476*want_1_psi, ", "s1.p2_bar, s1.p3_bar: [",
         "lab.map:1:1: .*lab.csv: no set-points of s1.p1_bar"),
        ("frame: {mirrored: yes}", "", "no frame; write"),
        ("frame: {mirrored: yes}", "smooth_mm: 1", "lab.map:6:1: smooth_mm is for trajectories"),
        ("frame: {mirrored: yes}", "frame: robot", "turn a right hand into a left one"),
    ],
)  # fmt: skip
def test_a_wrong_mapping_has_its_place(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ContidError, match=message):
        read(written(tmp_path, rows("100", 4.0)), MAP.replace(old, new, 1))


def test_a_recording_that_shows_nothing_is_refused(tmp_path: Path) -> None:
    gap, still, lost, quiet = (rows("100", 8.0) for _ in range(4))
    gap[200:, 0] += 3000.0
    still[:, 7:] = still[0, 7:]
    lost[:, 4:7] = np.nan
    quiet[:, 1:4] = 1.0
    for values, message in (
        (gap, "lab.csv:202:1: no sample for 3.03 s before this row"),
        (quiet[:60], "60 rows; at least 100 needed"),
        (quiet, "no set-point changes"),
        (still, "the measured tip never moves"),
    ):
        with pytest.raises(ContidError, match=message):
            read(written(tmp_path, values))
    # Lost measurements are no measurements; then nothing shows where the arm was before its first step.
    found = read(written(tmp_path, lost))
    assert found.recording.axis_at_s[0].size == 0
    assert any("mm before the first set-point changes (4.02 s)" in each for each in found.notes)


def test_a_table_needs_its_robot_to_be_predicted(tmp_path: Path) -> None:
    table, motion = written(tmp_path, rows("100")), tmp_path / "m.json"
    motion.write_text("{}")
    with pytest.raises(ContidError, match="format"):
        CliRunner().invoke(predict, [str(motion), str(table)], catch_exceptions=False)


@pytest.mark.slow
def test_from_tables_to_a_pattern_that_was_not_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lab.map").write_text(MAP)
    monkeypatch.setattr("contid_identify.remembered.MOST", 100)
    (tmp_path / "arm.yaml").write_text(load_named("stiffflop1").text)
    tables = [
        str(written(tmp_path, rows(each, 8.0), name=f"{each}.csv")) for each in ("100", "010", "001", "111")
    ]
    motion, other = tmp_path / "arm.motion.json", written(tmp_path, rows("101", 8.0))
    mapped, sides = ["--map", str(tmp_path / "lab.map")], ["--azimuths-deg", "0,180,none"]

    def run(*arguments: str) -> Result:
        own = [str(tmp_path / "arm.yaml"), *tables, *mapped, "--motion", str(motion), *arguments]
        return CliRunner().invoke(command, own, catch_exceptions=False)

    with pytest.raises(ContidError, match="--form arcs"):
        run(*sides)
    with pytest.raises(ContidError, match="number 2 is 'left'"):
        run("--form", "arcs", "--azimuths-deg", "0,left,none")
    with monkeypatch.context() as before:
        before.setattr("contid_identify.stages.identify", None)  # refused before the long fits
        with pytest.raises(ContidError, match="2 azimuths for 3 chambers"):
            run("--form", "arcs", "--azimuths-deg", "0,180")
    done = run("--form", "arcs", *sides)
    assert done.exit_code == 0, done.output
    assert "one chamber bends it by" in done.output
    with pytest.raises(ContidError, match="--for ROBOT_FILE"):
        CliRunner().invoke(predict, [str(motion), str(other)], catch_exceptions=False)
    csv = tmp_path / "tips.csv"
    robot = ["--for", str(tmp_path / "arm.yaml"), "--csv", str(csv)]
    CliRunner().invoke(predict, [str(motion), str(other), *mapped, *robot], catch_exceptions=False)
    tips = np.loadtxt(csv, delimiter=",", skiprows=1)
    off = np.linalg.norm(tips[:, 1:4] - tips[:, 4:7], axis=1)
    moved = np.linalg.norm(tips[:, 1:4] - tips[0, 1:4], axis=1)
    assert np.sqrt((off**2).mean()) < 0.1 * np.sqrt((moved**2).mean())


def tips_of_racks(tmp_path: Path, scale: float) -> TabledRecording:
    """A table of `trirack`, 50 mm long at rest and 650 at most, whose sections move about 300 mm together."""
    (robot,) = load_named("trirack").driven.values()
    at_s = np.arange(0.0, 20.0, 0.05)
    lengths_mm = 300.0 + 100.0 * np.sin(np.maximum(at_s - 1.0, 0.0))
    # Straight: the tip is as far away as the racks are long.
    lines = [
        f"{t:.2f},{s:.3f},{s:.3f},{s:.3f},0,0,{scale * s:.3f}" for t, s in zip(at_s, lengths_mm, strict=True)
    ]
    file = tmp_path / "racks.csv"
    file.write_text(
        "\n".join([f"t_s,{','.join(robot.columns)},meas.x_mm,meas.y_mm,meas.z_mm", *lines]) + "\n"
    )
    return read_tabled(file, "arm", robot, "", "")


def test_tips_of_a_robot_that_grows_are_taken_up_to_its_greatest_length(tmp_path: Path) -> None:
    found = tips_of_racks(tmp_path, 1.0)
    assert float(found.recording.tip_m[:, 2].max()) == pytest.approx(0.4, abs=1e-3)
    with pytest.raises(ContidError, match=r"robot is at most about 650 mm away: is its unit right\?"):
        tips_of_racks(tmp_path, 10.0)
