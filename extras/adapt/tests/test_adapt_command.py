"""The command as it is used, and the mappings that it proposes for known programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from contid.errors import ContidError
from contid_adapt.command import command
from contid_adapt.known import propose
from contid_adapt.reading.read import read_table

WALK = "t,x,y\n" + "".join(
    f"{k / 100:.2f},{20 + 5 * np.sin(np.pi / 200 * k) ** 2:.6f},80\n" for k in range(401)
)
MAP = "t_s: t\nx_mm, y_mm: [x, y]\nframe: robot\n"
#: Headers of public files and manuals; mappings by hand from these.
KNOWN = {
    "Motive": (
        "Format Version,1.23,Capture Frame Rate,100.0,Length Units,Meters\n\n"
        ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
        ",,Tip,Tip,Tip,Tip,Tip,Tip,Tip\n"
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
        "0,0.0,0,0,0,1,0.1,0.2,0.3\n1,0.01,0,0,0,1,0.1,0.2,0.3\n",
        "t_s: Time\nx_mm, y_mm, z_mm: [1000*Tip.Position.X, 1000*Tip.Position.Y, 1000*Tip.Position.Z]\n"
        "quaternion_xyzw: [Tip.Rotation.X, Tip.Rotation.Y, Tip.Rotation.Z, Tip.Rotation.W, z]\n"
        "frame: {up: y, origin: rest, at: rest}\n",
        "",
    ),
    "QTM": (
        "NO_OF_FRAMES\t2\nFREQUENCY\t100\nMARKER_NAMES\ttip\n1\t2\t3\n1\t2\t4\n",
        "# rate_hz: ?\nx_mm, y_mm, z_mm: [tip_X, tip_Y, tip_Z]\nframe: {up: z, origin: rest, at: rest}\n",
        "FREQUENCY 100",
    ),
    "EuRoC": (
        "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], "
        "q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
        "1403636580838555648,1,2,3,1,0,0,0\n1403636580843555328,1,2,3,1,0,0,0\n",
        "t_s: 1e-09*timestamp\nx_mm, y_mm, z_mm: [1000*p_RS_R_x, 1000*p_RS_R_y, 1000*p_RS_R_z]\n"
        "quaternion_wxyz: [q_RS_w, q_RS_x, q_RS_y, q_RS_z, z]\nframe: {up: z, origin: rest, at: rest}\n",
        "",
    ),
    "rostopic -p": (
        "%time,field.header.stamp,field.pose.position.x,field.pose.position.y,field.pose.position.z\n"
        "1464265231000000000,1464265231000000000,1,2,3\n1464265232000000000,1464265232000000000,1,2,3\n",
        "t_s: 1e-09*field.header.stamp\nx_mm, y_mm, z_mm: [1000*field.pose.position.x, "
        "1000*field.pose.position.y, 1000*field.pose.position.z]\nframe: {up: z, origin: rest, at: rest}\n",
        "",
    ),
    "trunk-stack": (
        "ID,x1,y1,z1,x2,y2,z2,x3,y3,z3\n0,.1,.1,.1,.1,.2,.1,.1,.3,.1\n1,.1,.1,.1,.1,.2,.1,.1,.3,.1\n",
        "# rate_hz: ?\nx_mm, y_mm, z_mm: [1000*x3, 1000*y3, 1000*z3]\n# other bodies begin with: x1, x2\n"
        "frame: {up: y, origin: rest, at: rest}\n",
        "rate_hz",
    ),
    "opencr-mujoco": (
        "timestamp,pattern_label,servo_4_mm,tip_x,tip_y,tip_z\n1778538602.5,a,1,2,3,4\n1778538603.1,a,1,2,3,4\n",
        "t_s: timestamp\nx_mm, y_mm, z_mm: [tip_x, tip_y, tip_z]\nframe: {up: z, origin: rest, at: rest}\n",
        "",
    ),
    "NDI": (
        "Tools,Port,Frame,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Error\n1,A,7,OK,1,0,0,0,1,2,3,.1\n1,A,8,OK,1,0,0,0,1,2,3,.1\n",
        "# rate_hz: ?\nx_mm, y_mm, z_mm: [Tx, Ty, Tz]\nquaternion_wxyz: [Q0, Qx, Qy, Qz, z]\n"
        "frame: {up: z, origin: rest, at: rest}\n",
        "rate_hz",
    ),
    "LeRobot": (
        '{"timestamp": 0.0, "frame_index": 0, "episode_index": 0, "action": [1, 2]}\n'
        '{"timestamp": 0.1, "frame_index": 1, "episode_index": 0, "action": [1, 2]}\n',
        "t_s: timestamp\n# x_mm, y_mm, z_mm: [?, ?, ?]\nframe: {up: z, origin: rest, at: rest}\n",
        "the columns of the position",
    ),
}


@pytest.mark.parametrize("program", KNOWN)
def test_a_known_program_has_a_mapping(program: str, tmp_path: Path) -> None:
    text, mapping, missing = KNOWN[program]
    path = tmp_path / "a.csv"
    path.write_text(text)
    found = propose(read_table(path), "stiffflop2")
    assert (found.program, found.text) == (program, mapping)
    assert missing in found.missing
    assert bool(missing) == bool(found.missing)


def run(folder: Path, *arguments: str, text: str = WALK, mapping: str = MAP) -> Result:
    (folder / "a.csv").write_text(text)
    (folder / "m.yaml").write_text(mapping)
    return CliRunner().invoke(command, [str(folder / "a.csv"), "--for", "finger", *arguments])


def test_without_a_mapping_it_prints_one_and_writes_nothing(tmp_path: Path) -> None:
    found = run(tmp_path, "-o", str(tmp_path / "o.csv"))
    assert "t_s: t\n" in found.output
    assert "?*x" in found.output  # Its unit is not stated.
    assert isinstance(found.exception, ContidError)
    assert not (tmp_path / "o.csv").exists()


def test_with_a_mapping_it_writes_what_the_robot_can_follow(tmp_path: Path) -> None:
    found = run(tmp_path, "--map", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "o.csv"))
    assert found.exit_code == 0
    assert "within reach" in found.output
    assert (tmp_path / "o.csv").read_text().splitlines()[:2] == [
        "t_s,x_mm,y_mm",
        "0.000000000,20.000000,80.000000",
    ]


@pytest.mark.parametrize(
    ("mapping", "words"),
    [(MAP.replace("frame: robot\n", ""), "no frame"), (MAP.replace("[x", "[x + 500"), "reach")],
)
def test_what_is_refused_leaves_an_older_file(tmp_path: Path, mapping: str, words: str) -> None:
    (tmp_path / "o.csv").write_text("older")
    found = run(tmp_path, "--map", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "o.csv"), mapping=mapping)
    assert words in str(found.exception)
    assert (tmp_path / "o.csv").read_text() == "older"


def test_auto_takes_a_mapping_that_is_whole_and_no_other(tmp_path: Path) -> None:
    text = WALK.replace("t,x,y", "t,x [mm],y [mm]", 1)
    found = run(tmp_path, "--map", "auto", "-o", str(tmp_path / "o.csv"), text=text)
    assert found.exit_code == 0, found.exception
    found = run(tmp_path, "--map", "auto", "-o", str(tmp_path / "p.csv"))
    assert "no mapping to take" in str(found.exception)
    assert not (tmp_path / "p.csv").exists()


def test_the_table_itself_is_not_replaced(tmp_path: Path) -> None:
    found = run(tmp_path, "--map", str(tmp_path / "m.yaml"), "-o", str(tmp_path / "a.csv"))
    assert "write to another file" in str(found.exception)
    assert (tmp_path / "a.csv").read_text() == WALK
