"""The golden trajectory of the CBHA, printed to follow."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from contid.cli.main import cli
from contid.errors import ContidError
from studies.golden_path import command
from studies.singh import golden_trajectory


def test_it_passes_the_golden_points() -> None:
    result = CliRunner().invoke(command, ["--period", "9.9", "--rate", "10", "--laps", "2"])
    rows = [[float(x) for x in row] for row in list(csv.reader(io.StringIO(result.stdout)))[1:]]
    table = np.array(rows)
    assert table.shape == (199, 4)
    np.testing.assert_allclose(table[:100, 1:], golden_trajectory().tips_m * 1e3, atol=1e-9)
    np.testing.assert_allclose(table[99:, 1:][::-1], table[:100, 1:], atol=1e-9)


def test_the_robot_follows_it(tmp_path: Path) -> None:
    path = CliRunner().invoke(command, ["--period", "20", "--rate", "10"], catch_exceptions=False)
    rows = tmp_path / "path.csv"
    rows.write_text(path.stdout)
    run = ["run", "cbha", "--mock", "--virtual", "--rate", "50", "--json", "--trajectory", str(rows)]
    result = CliRunner().invoke(cli, run, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    (report,) = json.loads(result.stdout)["robots"].values()
    assert report["tip_error_max_mm"] < 1e-3
    assert report["ticks_limited"] == {}


def test_more_rows_than_a_trajectory_may_have_are_refused() -> None:
    with pytest.raises(ContidError, match=r"4e\+06 rows; allowed are 2000000"):
        CliRunner().invoke(command, ["--rate", "1e6"], catch_exceptions=False)
