"""The papers' paths through ``contid path`` and ``contid run --mock --virtual``; the end of a real run."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from click.testing import CliRunner

from contid.cli.main import cli

PATHS = {
    "traverse": ("trirack", ["traverse", "--size", "300", "--height", "300"]),
    "diagonal": ("trirack", ["diagonal", "--size", "240", "--height", "250", "--dz", "100"]),
    "corners": ("trirack", ["corners", "--size", "240", "--height", "300"]),
    "two segments": ("trirack2", ["traverse", "--size", "200", "--height", "400"]),
    "two segments, direction": ("trirack2", ["circle", "--size", "160", "--height", "450", "--lean", "20"]),
}


@pytest.mark.parametrize(
    "name",
    [
        "corners",
        "two segments, direction",
        *(pytest.param(n, marks=pytest.mark.campaign) for n in ("traverse", "diagonal", "two segments")),
    ],
)
def test_the_papers_paths_run(name, tmp_path):
    robot, shape = PATHS[name]
    path = CliRunner().invoke(cli, ["path", *shape, "--period", "20", "--rate", "10"], catch_exceptions=False)
    assert path.exit_code == 0
    rows = tmp_path / "path.csv"
    rows.write_text(path.stdout)
    run = ["run", robot, "--mock", "--virtual", "--rate", "50", "--json", "--trajectory", str(rows)]
    result = CliRunner().invoke(cli, run, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    (report,) = json.loads(result.stdout)["robots"].values()
    assert report["ticks_followed"] >= 1000
    assert report["tip_error_max_mm"] < 1e-3
    assert report["ticks_limited"] == {}


@pytest.mark.process
@pytest.mark.true_process  # a forked one ends without what the interpreter does at its exit
@pytest.mark.parametrize(
    ("name", "z_mm"), [pytest.param("tendon3", 280, marks=pytest.mark.campaign), ("stiffflop2", 110)]
)
@pytest.mark.slow
def test_a_real_run_frees_its_kernels(name, z_mm, tmp_path):
    """Its process runs with a frozen collector: what a cycle of references keeps, nanobind reports."""
    rows = tmp_path / "rest.csv"
    rows.write_text(f"t_s,x_mm,y_mm,z_mm\n0,0,0,{z_mm}\n0.2,0,0,{z_mm}\n")
    run = [sys.executable, "-m", "contid", "run", name, "--mock", "--trajectory", str(rows)]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "nanobind: leaked" not in done.stderr
