"""Standard streams that are closed, full, gone or narrow: one message, its exit code, no traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.command import contid_in

pytestmark = pytest.mark.process

ROWS = "t_s,x_mm,y_mm\n0,20,80\n1,22,80\n"


def shell(line: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """A line of bash in which ``contid`` is the command."""
    (folder / "rows.csv").write_text(ROWS)
    function = f'contid() {{ "{sys.executable}" -m contid "$@"; }}; '
    done = subprocess.run(
        ["bash", "-c", function + line],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert "Traceback" not in done.stdout + done.stderr
    return done


@pytest.mark.parametrize(
    "command",
    [
        "schema",
        *(
            pytest.param(command, marks=pytest.mark.campaign)
            for command in ("path circle --center 50,70 --radius 20 --period 4", "ik finger rows.csv")
        ),
        pytest.param("check finger", marks=pytest.mark.campaign),
    ],
)
def test_a_full_disk_is_named(command: str, tmp_path: Path) -> None:
    done = shell(f"contid {command} > /dev/full", tmp_path)
    assert (done.returncode, "No space left on device" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    "command",
    [
        pytest.param("check hand", marks=pytest.mark.campaign),
        "path circle --center 50,70 --radius 20 --period 400",
        pytest.param("schema", marks=pytest.mark.campaign),
    ],
)
def test_a_reader_that_goes_away_is_no_failed_comparison(command: str, tmp_path: Path) -> None:
    assert shell(f"set -o pipefail; contid {command} | head -n 1", tmp_path).returncode == 0


@pytest.mark.parametrize(
    "redirection",
    [*(pytest.param(each, marks=pytest.mark.campaign) for each in (">&-", "2>&-", "<&-")), "<&- >&- 2>&-"],
)
def test_closed_streams_are_empty_ones(redirection: str, tmp_path: Path) -> None:
    assert (
        shell(
            f"contid run finger --virtual --trajectory rows.csv --record a.mcap {redirection}", tmp_path
        ).returncode
        == 0
    )
    assert "clean" in contid_in(tmp_path, "session", "info", "a.mcap").stdout


def test_rows_from_a_closed_stdin_are_no_rows(tmp_path: Path) -> None:
    done = shell("contid ik finger <&-", tmp_path)
    assert (done.returncode, "no rows" in done.stderr) == (2, True)


@pytest.mark.parametrize("limit", [7, 8, pytest.param(9, marks=pytest.mark.campaign)])
def test_too_few_descriptors_are_named(tmp_path: Path, limit: int) -> None:
    done = shell(f"ulimit -n {limit}; contid run finger --mock --socket ./s", tmp_path)
    assert (done.returncode, "Too many open files: raise the limit (ulimit -n)" in done.stderr) == (2, True)


def test_a_narrow_encoding_writes_what_it_can(tmp_path: Path) -> None:
    assert shell("contid check hand", tmp_path, PYTHONIOENCODING="latin-1").returncode == 0


def test_the_exit_code_stays_when_stderr_cannot_be_written(tmp_path: Path) -> None:
    assert shell("contid check 2> /dev/full", tmp_path).returncode == 2
    assert shell("contid check nowhere.yaml 2> /dev/full", tmp_path).returncode == 2


def test_a_recording_of_a_file_whose_name_is_no_text(tmp_path: Path) -> None:
    run = "contid run finger --virtual --trajectory $'\\xff.csv' --record a.mcap"
    assert shell(f"cp rows.csv $'\\xff.csv'; {run}", tmp_path).returncode == 0
    done = contid_in(tmp_path, "session", "info", "a.mcap")
    assert (done.returncode, "\\udcff.csv" in done.stdout) == (0, True)


def test_an_export_to_a_full_disk_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "rows.csv").write_text(ROWS)
    contid_in(tmp_path, "run", "finger", "--virtual", "--trajectory", "rows.csv", "--record", "a.mcap")
    (tmp_path / "full.csv").symlink_to("/dev/full")
    done = contid_in(tmp_path, "session", "export", "a.mcap", "--csv", "full.csv")
    assert (done.returncode, "full.csv: cannot write it: No space left" in done.stderr) == (2, True)
