"""`Robot.workspace` against the inverse on random points, and what `Robot.plot` and the notebook draw."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest

from contid import Robot
from contid.errors import ContidError, MissingExtraError

ROOT = Path(__file__).parents[3]
NOTEBOOK = ROOT / "examples" / "workspace.ipynb"

mpl.use("Agg")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "which"), [("finger", None), ("hand", "right"), ("stiffflop1", None)])
def test_the_size_is_the_share_of_random_points_that_the_inverse_reaches(
    name: str, which: str | None
) -> None:
    robot = Robot(name)[which] if which else Robot(name)
    found = robot.workspace(across=12) if robot.dimension == 3 else robot.workspace()
    low, high = found.bounds
    rng = np.random.default_rng(5)
    count = 2000
    reached = robot.ik(rng.uniform(low, high, (count, robot.dimension))).converged.mean()
    share = found.size / np.prod(high - low)
    spread = 4.0 * np.sqrt(share * (1.0 - share) / count)
    assert abs(reached - share) < spread + found.uncertainty / np.prod(high - low)


def test_the_points_of_a_plane_are_an_outline_and_those_in_space_are_reached() -> None:
    finger = Robot("finger").workspace()
    assert finger.points.shape[1] == 2
    assert finger.uncertainty == 0.0
    arm = Robot("stiffflop1")
    found = arm.workspace(voxel=15.0)
    assert found.voxel == pytest.approx(15.0)
    assert arm.ik(found.points).residual.max() < 0.5
    assert found.size == pytest.approx(len(found.points) * 15.0**3)


@pytest.mark.slow
def test_si_has_other_numbers_only() -> None:
    edge, si = Robot("finger").workspace(), Robot("finger", si=True).workspace()
    assert si.size == pytest.approx(edge.size * 1e-6)
    assert si.bounds == pytest.approx(edge.bounds * 1e-3)
    edge, si = Robot("stiffflop1").workspace(30.0), Robot("stiffflop1", si=True).workspace(0.03)
    assert si.size == pytest.approx(edge.size * 1e-9)
    assert si.points == pytest.approx(edge.points * 1e-3)


@pytest.mark.parametrize("name", ["finger", "trirack2", "stiffflop2"])
def test_a_plot_has_the_backbones_and_the_points(name: str) -> None:
    import matplotlib.pyplot as plt

    robot = Robot(name)
    rows = np.stack([robot.limits.rest, 0.5 * (robot.limits.min + robot.limits.max)])
    tips = robot.fk(rows).tip
    axes = robot.plot(points=tips, values=[1.0, 2.0], label="residual [mm]")
    assert robot.plot(rows, axes=axes) is axes
    assert len(axes.lines) == 2
    assert axes.get_xlabel() == "x [mm]"
    assert [other.get_ylabel() for other in axes.figure.axes if other is not axes] == ["residual [mm]"]
    drawn: Any = axes.lines[1]
    line = np.transpose(drawn.get_data_3d() if robot.dimension == 3 else drawn.get_data())
    assert np.allclose(line, robot.backbone(rows[1]))
    assert len(robot.plot().lines) == 1
    plt.close("all")


def test_mistakes(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = Robot("finger")
    with pytest.raises(ContidError, match=re.escape("values has shape (3,); expected (2,), one per row")):
        robot.plot(points=[[1, 2], [3, 4]], values=[1, 2, 3])
    with pytest.raises(ContidError, match="voxel=-1"):
        Robot("stiffflop1").workspace(-1.0)
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(MissingExtraError, match=r"plot needs matplotlib: pip install 'contid\[plots\]'"):
        robot.plot()
    monkeypatch.setitem(sys.modules, "shapely", None)
    with pytest.raises(MissingExtraError, match=r"workspace needs shapely: pip install 'contid\[plots\]'"):
        robot.workspace()


@pytest.mark.process
@pytest.mark.parametrize("points", ["1_000", pytest.param("10_000", marks=pytest.mark.campaign)])
def test_the_notebook_runs_in_ten_lines_and_draws(points: str, tmp_path: Path) -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], [cell["cell_type"] for cell in notebook["cells"]]) == (
        4,
        ["markdown", "code"],
    )
    assert not any(cell.get("outputs") for cell in notebook["cells"])
    source = "".join(notebook["cells"][1]["source"])
    assert len([line for line in source.splitlines() if line.strip()]) <= 10
    assert source.count("10_000") == 1
    source = source.replace("10_000", points)
    script = tmp_path / "cells.py"
    check = (
        "\naxes.figure.savefig('out.png')\n"
        "assert len(axes.lines) == 5, axes.lines\n"
        f"assert axes.collections[0].get_array().shape == ({points},)\n"
    )
    script.write_text(source + check)
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=tmp_path,
        env={
            **os.environ,
            "MPLBACKEND": "Agg",
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "drivers")]),
        },
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    reached = re.search(r"(\d+)% within reach, the others up to ([\d.]+) mm away", done.stdout)
    assert reached
    assert 30 < int(reached[1]) < 95
    assert (tmp_path / "out.png").stat().st_size > 20_000
