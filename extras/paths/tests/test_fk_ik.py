"""``contid fk`` and ``contid ik`` as filters: each reads what the other writes."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import pytest
import yaml

from tests.support.command import contid

pytestmark = pytest.mark.process


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_ik_undoes_fk_and_passes_the_time_through() -> None:
    racks = "t_s,left_mm,right_mm\n0,60,80\n0.5,70.25,61\n"
    forward = contid("fk", "finger", stdin=racks)
    assert forward.returncode == 0, forward.stderr
    back = rows(contid("ik", "finger", stdin=forward.stdout).stdout)
    assert [float(row["t_s"]) for row in back] == [0.0, 0.5]
    assert [float(row["left_mm"]) for row in back] == pytest.approx([60, 70.25], abs=1e-9)
    assert [float(row["right_mm"]) for row in back] == pytest.approx([80, 61], abs=1e-9)
    assert all(row["converged"] == "true" and row["iterations"] == "0" for row in back)


def test_both_fingers_of_the_hand_meet_in_the_world_frame() -> None:
    point = "left.x_mm,left.y_mm,right.x_mm,right.y_mm\n60,70,60,70\n"
    solved = contid("ik", "hand", stdin=point)
    assert solved.returncode == 0, solved.stderr
    racks = rows(solved.stdout)[0]
    text = ",".join(name for name in racks if name.endswith(("left_mm", "right_mm")))
    text += "\n" + ",".join(racks[name] for name in racks if name.endswith(("left_mm", "right_mm"))) + "\n"
    tip = rows(contid("fk", "hand", stdin=text).stdout)[0]
    assert [float(value) for value in tip.values()] == pytest.approx([60, 70, 60, 70], abs=1e-9)


def test_a_target_out_of_reach_gets_an_answer_that_names_its_limit() -> None:
    answer = contid("ik", "finger", "--json", stdin="x_mm,y_mm\n0,200\n")
    found = json.loads(answer.stdout)
    assert found["converged"] is False
    assert found["limited_by"] == "left.max right.max"
    assert found["residual_mm"] == pytest.approx(78.0, abs=1e-6)
    assert answer.returncode == 0


def test_bare_rows_of_ik_are_read_by_fk_with_their_loads_and_further_axes() -> None:
    load = ",load.fx_n,load.fy_n,load.fz_n"
    for robot, columns, row in (
        ("finger", "t_s,x_mm,y_mm", "0.5,20,80"),
        ("cbha", "x_mm,y_mm,z_mm,gripper_mm", "20,0,240,3"),
        ("stiffflop1", f"x_mm,y_mm,z_mm{load}", "5,0,45,0,0,0.05"),
    ):
        solved = contid("ik", robot, "--bare", stdin=f"{columns}\n{row}\n")
        assert solved.returncode == 0, solved.stderr
        answer = rows(solved.stdout)[0]
        back = contid("fk", robot, stdin=solved.stdout)
        assert back.returncode == 0, back.stderr
        tip = rows(back.stdout)[0]
        for name, value in zip(columns.split(","), map(float, row.split(",")), strict=True):
            kept = tip if name in tip else answer
            assert float(kept[name]) == pytest.approx(value, abs=1e-3)


@pytest.mark.parametrize("remark", ["", "# rows after a remark are read one by one\n"])
def test_bare_rows_keep_further_axes_in_their_own_unit(remark: str, configs: Path, tmp_path: Path) -> None:
    head, _, example = (configs / "finger.yaml").read_text().partition("# A wrist and a gripper")
    lines = [line.removeprefix("# ") for line in example.splitlines()[1:] if line.startswith("#   ")]
    document, added = yaml.safe_load(head), yaml.safe_load("\n".join(lines))
    robot = document["robots"]["finger"]
    robot["extra_deg"] = added["extra_deg"]
    robot["rates"] |= added["rates"]
    robot["axes"] |= added["axes"]
    (tmp_path / "wrist.yaml").write_text(yaml.safe_dump(document))
    given = f"x_mm,y_mm,wrist_deg,gripper_deg\n{remark}20,80,45,30\n"
    solved = contid("ik", str(tmp_path / "wrist.yaml"), "--bare", stdin=given)
    assert solved.returncode == 0, solved.stderr
    (answer,) = rows(solved.stdout)
    assert [float(answer[name]) for name in ("wrist_deg", "gripper_deg")] == pytest.approx([45.0, 30.0])


def test_a_bare_row_out_of_reach_ends_it() -> None:
    done = contid("ik", "finger", "--bare", stdin="x_mm,y_mm\n20,80\n0,200\n")
    assert done.returncode == 2
    assert len(done.stdout.splitlines()) == 2
    assert "stdin:3:1: finger: out of reach by 78 mm, limited by left.max right.max" in done.stderr


@pytest.mark.parametrize(
    ("command", "text", "place", "message"),
    [
        ("ik", "x_mm,y_mm\n10,60\n10,nan\n", "stdin:3:4:", "y_mm is nan"),
        ("ik", "x_mm\n10\n", "stdin:1:", "y_mm"),
        ("fk", "x_mm,y_mm\n10,60\n", "stdin:2:1:", "left_mm, right_mm"),
        ("fk", "", "stdin:1:1:", "no rows"),
    ],
)
def test_a_mistake_is_named_with_its_place(command: str, text: str, place: str, message: str) -> None:
    done = contid(command, "finger", stdin=text)
    assert done.returncode == 2
    assert place in done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_shipped_robot_file_is_found_by_name_and_a_wrong_name_gets_the_nearest() -> None:
    done = contid("fk", "fingr", stdin="left_mm,right_mm\n60,60\n")
    assert done.returncode == 2
    assert "did you mean 'finger'" in done.stderr
