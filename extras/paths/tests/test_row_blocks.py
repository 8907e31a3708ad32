"""Rows in blocks have the output of rows one by one, to the last character."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from contid_paths import row_blocks
from contid_paths.kinematics_command import fk, ik
from tests.support.command import contid

LOAD = ",load.fx_n,load.fy_n,load.fz_n"


@pytest.fixture
def one_by_one(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    with monkeypatch.context() as patched:
        patched.setattr(row_blocks, "numbers", lambda layout, lines: None)
        yield patched


def table(header: str, low: list[float], high: list[float], count: int) -> str:
    values = np.random.default_rng(3).uniform(low, high, (count, len(low)))
    text = io.StringIO()
    np.savetxt(text, values, delimiter=",", header=header, comments="", fmt="%.9g")
    return text.getvalue()


def output(command: click.Command, *words: str, stdin: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(command, words, input=stdin)
    return done.exit_code, done.stdout, str(done.exception)


CASES = {
    "cbha": (ik, ("cbha",), table("x_mm,y_mm,z_mm", [-90, -90, 180], [90, 90, 280], 60)),
    "directions and time": (
        ik,
        ("cbha",),
        table("t_s,x_mm,y_mm,z_mm,ax,ay,az", [0, -50, -50, 200, -1, -1, 0.2], [9, 50, 50, 260, 1, 1, 1], 20),
    ),
    "frames": (
        ik,
        ("trirack2",),
        table(
            "x_mm,y_mm,z_mm,ax,ay,az,bx,by,bz",
            [-20, -20, 230, -1, -1, 3, 1, -1, -1],
            [20, 20, 260, 1, 1, 4, 2, 1, 1],
            20,
        ),
    ),
    "two fingers": (
        ik,
        ("hand",),
        table("left.x_mm,left.y_mm,right.x_mm,right.y_mm", [20, 40, 20, 40], [80, 110, 80, 110], 60),
    ),
    "a load": (
        ik,
        ("stiffflop1",),
        table(f"x_mm,y_mm,z_mm{LOAD}", [-15, -15, 40, 0, 0, -0.05], [15, 15, 55, 0.02, 0, 0], 20),
    ),
    "bare": (
        ik,
        ("cbha", "--bare"),
        table("x_mm,y_mm,z_mm,gripper_mm", [-20, -20, 230, 0], [20, 20, 250, 9], 60),
    ),
    "bare to the first out of reach": (
        ik,
        ("finger", "--bare"),
        table("x_mm,y_mm", [0, 60], [50, 120], 60),
    ),
    "fk": (
        fk,
        ("cbha", "--pose"),
        table("s1.l1_mm,s1.l2_mm,s1.l3_mm,s2.l1_mm,s2.l2_mm,s2.l3_mm", [100] * 6, [140] * 6, 60),
    ),
    "fk with frames": (
        fk,
        ("trirack2", "--frame"),
        table("s1.l1_mm,s1.l2_mm,s1.l3_mm,s2.l1_mm,s2.l2_mm,s2.l3_mm", [100] * 6, [140] * 6, 20),
    ),
    "fk of a hand": (
        fk,
        ("hand", "--pose"),
        table("left.left_mm,left.right_mm,right.left_mm,right.right_mm", [60] * 4, [80] * 4, 60),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_the_output_is_that_of_single_rows(
    case: str, monkeypatch: pytest.MonkeyPatch, one_by_one: pytest.MonkeyPatch
) -> None:
    command, words, text = CASES[case]
    single = output(command, *words, stdin=text)
    one_by_one.undo()
    monkeypatch.setattr(row_blocks, "ROWS", 16)
    assert output(command, *words, stdin=text) == single
    assert single[1].count("\n") > 2, single


@pytest.mark.process
@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("10,60\n10,60,1\n", "3:7"),
        ("10,60\n10\n10,60,1\n", "3:"),
        ("10,60\n\n# a remark\n10,x\n", "5:4"),
        ("10,60\n10,1_0\n", "3:4"),
        ("10,60\n10,1e11\n", "3:4"),
        ("10,60\r\n10,nan\r\n", "3:4"),
        ('"10",60\n10,"60\n', "3:4"),
    ],
)
def test_a_mistake_in_a_block_is_named_with_its_place_after_the_rows_before(text: str, place: str) -> None:
    done = contid("ik", "finger", stdin="x_mm,y_mm\n" + text)
    assert done.returncode == 2
    assert f"stdin:{place}" in done.stderr
    assert len(done.stdout.splitlines()) == 2


@pytest.mark.process
def test_rows_typed_into_a_pipe_are_answered_at_once() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "contid", "ik", "finger"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    ) as process:
        assert process.stdin
        assert process.stdout
        process.stdin.write("x_mm,y_mm\n10,60\n")
        process.stdin.flush()
        assert process.stdout.readline().startswith("left_mm")
        first = process.stdout.readline()
        process.stdin.write("10,60\n")
        process.stdin.flush()
        assert process.stdout.readline() == first
        process.stdin.close()
        assert process.wait(60) == 0


def test_line_ends_may_be_split_between_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "\ufeffa,b\r\n1,2\r3,4\n\u00e4,6".encode()
    for size in range(1, len(text)):
        monkeypatch.setattr(row_blocks, "_BYTES", size)
        blocks = list(row_blocks.line_blocks(io.TextIOWrapper(io.BytesIO(text))))
        lines = {number + k: line for number, lines in blocks for k, line in enumerate(lines)}
        assert lines == {1: "a,b", 2: "1,2", 3: "3,4", 4: "\u00e4,6"}, size


def test_a_header_in_a_comment_may_come_before_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pipe delivers lines as they are written; what they mean does not depend on that."""
    text = "# left_mm,right_mm\n\n60,70\n61,70\n"
    whole = output(fk, "finger", stdin=text)
    assert whole[0] == 0
    monkeypatch.setattr(row_blocks, "_BYTES", 1)
    assert output(fk, "finger", stdin=text) == whole
