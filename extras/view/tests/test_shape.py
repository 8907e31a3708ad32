"""``contid shape``: the model's backbone, and the reconstruction from measured poses, on one command line."""

from __future__ import annotations

import csv
import io
import json
import math

import pytest

from tests.support.command import contid

pytestmark = pytest.mark.process

POSTURE = "s1.l1_mm,s1.l2_mm,s1.l3_mm,s2.l1_mm,s2.l2_mm,s2.l3_mm\n110,125,140,95,120,100\n"
TIP = (-75.5225946934, 15.7220420260, 210.9108878265)
DIRECTION = (-0.616595697949, -0.164951229246, 0.769805713957)


def table(text: str) -> list[dict[str, float]]:
    return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(io.StringIO(text))]


def test_the_model_s_backbone_goes_from_the_base_to_the_golden_tip() -> None:
    done = contid("shape", "cbha", "--points", "11", stdin=POSTURE)
    assert done.returncode == 0, done.stderr
    rows = table(done.stdout)
    assert list(rows[0]) == ["row", "s_mm", "x_mm", "y_mm", "z_mm"]
    assert len(rows) == 11
    assert [rows[0][key] for key in ("s_mm", "x_mm", "y_mm", "z_mm")] == [0, 0, 0, 0]
    assert [rows[-1][key] for key in ("x_mm", "y_mm", "z_mm")] == pytest.approx(TIP, abs=1e-6)
    assert rows[-1]["s_mm"] == pytest.approx(230.0, abs=1e-4)


def test_a_measured_pose_gives_the_golden_curve() -> None:
    poses = "x_mm,y_mm,z_mm,ax,ay,az\n" + ",".join(map(repr, TIP + DIRECTION)) + "\n"
    arguments = ("shape", "cbha", "--from-poses", "--length-mm", "125,105", "--points", "3", "--json")
    done = contid(*arguments, stdin=poses)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["robots"]["cbha"]
    assert found["length_mm"] == pytest.approx(230.0)
    assert found["points_mm"][1] == pytest.approx([-19.0303238609, 12.8170435029, 111.9638912752], abs=2e-6)
    unknown = json.loads(contid("shape", "cbha", "--from-poses", "--json", stdin=poses).stdout)
    assert unknown["robots"]["cbha"]["length_mm"] == pytest.approx(229.629260101439)


def test_a_length_shorter_than_the_chord_is_reported_with_its_row() -> None:
    poses = "x_mm,y_mm,z_mm,ax,ay,az\n0,0,230,0,0,1\n"
    done = contid("shape", "cbha", "--from-poses", "--length-mm", "200", stdin=poses)
    assert done.returncode == 0
    assert "stdin:2:1: cbha:" in done.stderr
    assert "30 mm shorter than the chord" in done.stderr


def test_robots_of_a_hand_stand_in_the_world_and_keep_their_time() -> None:
    racks = "t_s,left.left_mm,left.right_mm,right.left_mm,right.right_mm\n0,60,80,60,80\n0.5,60,60,60,60\n"
    done = contid("shape", "hand", "--points", "5", stdin=racks)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert len(rows) == 2 * 2 * 5
    assert {row["robot"] for row in rows} == {"left", "right"}
    assert rows[-1]["t_s"] == "0.5"
    # The result of fk for the same racks.
    tips = next(csv.DictReader(io.StringIO(contid("fk", "hand", stdin=racks).stdout)))
    last = next(row for row in reversed(rows) if row["robot"] == "right" and row["row"] == "1")
    assert math.dist(
        (float(last["x_mm"]), float(last["y_mm"])), (float(tips["right.x_mm"]), float(tips["right.y_mm"]))
    ) == pytest.approx(0.0, abs=1e-5)


def test_the_rope_of_a_chain_hangs_between_the_tips_of_its_arms() -> None:
    poses = "left.x_mm,left.y_mm,left.z_mm,left.ax,left.ay,left.az,"
    poses += poses.replace("left", "right").rstrip(",") + "\n0,0,240,0,0,1,700,0,240,0,0,1\n"
    arguments = ("shape", "chain", "--from-poses", "--length-mm", "240", "--points", "5", "--json")
    done = contid(*arguments, stdin=poses)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["robots"]
    assert list(found) == ["left", "right", "rope"]
    rope = found["rope"]
    assert rope["length_mm"] == pytest.approx(1000.0)
    assert rope["points_mm"][0] == found["left"]["points_mm"][-1]
    assert rope["points_mm"][-1] == pytest.approx(found["right"]["points_mm"][-1], abs=2e-6)
    assert rope["points_mm"][2][2] == pytest.approx(-78.5, abs=10.0)
    # Too far apart: an answer with its place.
    apart = contid(*arguments, stdin=poses.replace("700", "1010"))
    assert apart.returncode == 2
    assert "stdin:2:1: rope: the rope is 10 mm too short" in apart.stderr


@pytest.mark.parametrize(
    ("arguments", "text", "message"),
    [
        ((), "x_mm,y_mm,z_mm\n0,0,220\n", "stdin:2:1: shape needs the actuation of cbha"),
        (("--from-poses",), "x_mm,y_mm,z_mm\n0,0,220\n", "needs position and direction of cbha"),
        (("--length-mm", "200"), POSTURE, "--length-mm needs --from-poses"),
        (("--from-poses", "--length-mm", "0"), POSTURE, "x>0"),
        ((), "", "stdin:1:1: no rows"),
    ],
)
def test_mistakes_are_named(arguments: tuple[str, ...], text: str, message: str) -> None:
    done = contid("shape", "cbha", *arguments, stdin=text)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
