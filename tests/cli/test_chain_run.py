"""The swing of a rope between two arms, from ``contid path`` to ``contid run``, and what is refused."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from tests.support.command import contid

pytestmark = pytest.mark.process

HEADER = "t_s,left.x_mm,left.y_mm,left.z_mm,right.x_mm,right.y_mm,right.z_mm\n"


@pytest.fixture(scope="module")
def swing() -> str:
    done = contid("path", "swing", "--for", "chain", "--rate", "20")
    assert done.returncode == 0, done.stderr
    return done.stdout


def changed(tmp_path: Path, configs: Path, old: str, new: str) -> str:
    text = (configs / "chain.yaml").read_text()
    assert old in text
    path = tmp_path / "chain.yaml"
    path.write_text(text.replace(old, new))
    return str(path)


def test_both_tips_swing_in_step_and_mirrored(swing: str) -> None:
    rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(io.StringIO(swing))]
    assert len(rows) == 81
    for row in rows:
        assert row["left.y_mm"] == pytest.approx(row["right.y_mm"], abs=1e-9)
        assert row["left.x_mm"] + row["right.x_mm"] == pytest.approx(700.0, abs=1e-9)
        ellipse = (row["left.y_mm"] / 40.0) ** 2 + (row["left.x_mm"] / (40.0 * 2.0 / 3.0)) ** 2
        assert ellipse == pytest.approx(1.0)
    assert max(row["left.y_mm"] for row in rows) == 40.0


def test_the_arms_follow_the_swing(swing: str) -> None:
    done = contid("run", "chain", "--mock", "--virtual", stdin=swing)
    assert done.returncode == 0, done.stderr
    assert "left: OFF" in done.stdout
    assert "right: OFF" in done.stdout


def test_a_rope_below_its_floor_is_refused_with_the_line(swing: str, tmp_path: Path, configs: Path) -> None:
    high = changed(tmp_path, configs, "floor_mm: -150", "floor_mm: -80")
    for extra in ((), ("--unreachable", "nearest")):
        done = contid("run", high, "--mock", "--virtual", *extra, stdin=swing)
        assert done.returncode == 2
        assert "below its floor (-80 mm)" in done.stderr
        assert "stdin:2:" not in done.stderr  # the span is wide enough there
        # Both arms, one message.
        lines = [line for line in done.stderr.splitlines() if "floor" in line]
        assert len({line.split(":")[-4] for line in lines}) == len(lines)


def test_a_rope_that_reaches_no_more_between_two_rows_is_refused(tmp_path: Path, configs: Path) -> None:
    short = changed(tmp_path, configs, "length_mm: 1000", "length_mm: 705")
    # On both rows one tip is aside, on the way between them neither comes nearer to the other.
    rows = "0,40,0,240,660,0,240\n2,0,0,240,700,0,240\n4,-40,0,240,700,0,240\n6,40,0,240,660,0,240\n"
    done = contid("run", short, "--mock", "--virtual", stdin=HEADER + rows)
    assert done.returncode == 2
    assert "stdin:4:1: on the way to this row, rope: the rope is" in done.stderr
    assert "too short between left and right" in done.stderr
    assert "stdin:3:" not in done.stderr


def test_a_live_row_that_the_chain_forbids_holds_both_arms(tmp_path: Path, configs: Path) -> None:
    short = changed(tmp_path, configs, "length_mm: 1000", "length_mm: 705")
    header = HEADER.removeprefix("t_s,")
    rows = "0,0,240,700,0,240\n-30,0,240,730,0,240\n0,10,240,700,10,240\n"
    done = contid("run", short, "--mock", "--virtual", stdin=header + rows)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "holding" in line]
    assert len(lines) == 1
    assert lines[0].endswith("stdin:3:1: rope: the rope is 55 mm too short between left and right; holding")


def test_a_swing_needs_a_chain() -> None:
    done = contid("path", "swing", "--for", "finger")
    assert done.returncode == 2
    assert "describes no chain" in done.stderr
