"""Motions that excite a robot are accepted by the check of trajectories, and move every axis."""

from __future__ import annotations

import io
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner

from contid.control.daemon.check_trajectory import check_trajectory
from contid.errors import ContidError
from contid_identify.excite_command import command
from contid_identify.motions import KINDS


def written(tmp_path: Path, *arguments: str) -> tuple[str, list[str], np.ndarray]:
    path = tmp_path / "e.csv"
    done = CliRunner().invoke(command, [*arguments, "-o", str(path)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    text = path.read_text()
    header = text.partition("\n")[0].split(",")
    return text, header, np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["finger", "tendon3", pytest.param("planar2", marks=pytest.mark.campaign)])
def test_the_check_accepts_it_and_every_axis_moves(robot: str, tmp_path: Path) -> None:
    text, header, rows = written(tmp_path, robot, "--duration", "12")
    checked = check_trajectory(robot, "e.csv", io.StringIO(text))
    assert checked.duration_s > 9.0
    assert (np.ptp(rows[:, 1:], axis=0) > 0.0).all()
    assert header[0] == "t_s"
    assert np.allclose(rows[0, 1::2], rows[-1, 1::2], atol=0.1)  # ends where it began


def test_ring_downs_end_with_rests(tmp_path: Path) -> None:
    _, _, rows = written(tmp_path, "finger", "--duration", "12", "--part", "ring-downs")
    moves = np.abs(np.diff(rows[:, 1:], axis=0)).max(axis=1) > 1e-6
    longest, run = 0, 0
    for move in moves.tolist():
        run = 0 if move else run + 1
        longest = max(longest, run)
    assert longest / 50.0 > 2.5


def test_mistakes_are_named(tmp_path: Path) -> None:
    out = str(tmp_path / "e.csv")
    for arguments, message in (
        (["hand", "-o", out], "--robot"),
        (["finger", "--robot", "x", "-o", out], "'x'"),
    ):
        with pytest.raises(ContidError, match=message):
            CliRunner().invoke(command, arguments, catch_exceptions=False)


@pytest.mark.parametrize("option", ["--duration", "--upper-hz"])
def test_numbers_are_finite(option: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["finger", "-o", str(tmp_path / "e.csv"), option, "nan"])
    assert done.exit_code == 2
    assert "not a finite number" in done.output


def test_the_command_offers_every_kind() -> None:
    (kinds,) = [each.type.choices for each in command.params if isinstance(each.type, click.Choice)]
    assert tuple(kinds) == tuple(KINDS)


@pytest.mark.parametrize("kind", ["steps", "sines"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_seed_draws_others_and_repeats_its_own(kind: str, count: int) -> None:
    first, again, other = (KINDS[kind](count, 8.0, 2.0, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first(1.5), again(1.5))
    rows, others = first(1.0), other(1.0)
    assert rows.shape != others.shape or np.abs(rows - others).max() > 0.1


def test_steps_that_are_slower_stand_at_the_same_poses() -> None:
    motion = KINDS["steps"](2, 12.0, 2.0, np.random.default_rng(3))
    stands = []
    for slowed in (1.0, 1.5):
        rows = motion(slowed)
        still = (np.diff(rows, axis=0) == 0.0).all(axis=1)
        stands.append(rows[1:][still & ~np.append(False, still[:-1])])
    assert stands[0] == pytest.approx(stands[1], abs=1e-9)
    assert len(stands[0]) == 8  # the middle, two away and back, two together, the middle


@pytest.mark.parametrize(("kind", "crossings"), [("sines", 1), ("chirp", 0)])
def test_short_parts_are_not_faster_than_the_highest_frequency(kind: str, crossings: int) -> None:
    """A wave of 0.2 Hz crosses zero once at most within 2.5 s, and not at all where it begins there."""
    for seed in range(20):
        rows = KINDS[kind](1, 2.5, 0.2, np.random.default_rng(seed))(1.0)[:, 0]
        signs = np.sign(rows[np.abs(rows) > 1e-9])
        assert np.count_nonzero(np.diff(signs)) <= crossings
