"""The tip's whole frame from the command line: solved, run, recorded, exported and replayed."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.command import environment

pytestmark = pytest.mark.process

AXES = ("x_mm", "y_mm", "z_mm", "ax", "ay", "az", "bx", "by", "bz")


def contid(folder: Path, *words: str, stdin: str | None = None) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "contid", *words], cwd=folder, env=environment(), input=stdin,
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def table(text: str, columns: tuple[str, ...] = AXES) -> np.ndarray:
    rows = list(csv.DictReader(text.splitlines()))
    return np.array([[float(row[column]) for column in columns] for row in rows])


@pytest.mark.parametrize("name", ["tendon3", "ftdcr_v4", "trirack2", "cbha"])
def test_frames_of_the_forward_kinematics_are_met_again(name: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    lines = {
        "tendon3": "x_mm,y_mm,z_mm\n" + "\n".join(f"{x},{y},285" for x, y in rng.uniform(-50, 50, (9, 2))),
        "ftdcr_v4": "x_mm,y_mm,z_mm\n" + "\n".join(f"{x},{y},170" for x, y in rng.uniform(-30, 30, (9, 2))),
        "trirack2": "x_mm,y_mm,z_mm\n" + "\n".join(f"{x},{y},250" for x, y in rng.uniform(-40, 40, (9, 2))),
        "cbha": "x_mm,y_mm,z_mm\n" + "\n".join(f"{x},{y},240" for x, y in rng.uniform(-30, 30, (9, 2))),
    }[name]
    axes = contid(tmp_path, "ik", name, "--bare", stdin=lines + "\n")
    frames = contid(tmp_path, "fk", name, "--frame", stdin=axes)
    again = contid(
        tmp_path, "fk", name, "--frame", stdin=contid(tmp_path, "ik", name, "--bare", stdin=frames)
    )
    asked = table(frames)
    assert np.abs(np.einsum("ni,ni->n", asked[:, 3:6], asked[:, 6:])).max() < 1e-12
    np.testing.assert_allclose(table(again), asked, atol=1e-4)


def test_a_path_with_frames_is_run_recorded_and_replayed(tmp_path: Path) -> None:
    path = (
        "path",
        "circle",
        "--size",
        "60",
        "--height",
        "280",
        "--lean",
        "20",
        "--roll",
        "0",
        "--period",
        "4",
    )
    text = contid(tmp_path, *path, "--for", "tendon3")
    (tmp_path / "frames.csv").write_text(text)
    run = ("run", "tendon3", "--mock", "--virtual", "--trajectory", "frames.csv")
    contid(tmp_path, *run, "--record", "frames.mcap")
    contid(tmp_path, "replay", "frames.mcap")
    contid(tmp_path, "session", "export", "frames.mcap", "--csv", "out")
    exported = "\n".join(path.read_text() for path in (tmp_path / "out").glob("*target*"))
    assert "bx" in exported.splitlines()[0]
