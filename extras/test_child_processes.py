"""Child processes import the package of the daemon, whatever lies in the working directory."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import contid
from contid.control.daemon.spawn import module_command

ROWS = "t_s,x_mm,y_mm\n0,50,75\n0.2,51,75\n"
OPTIONS: tuple[list[str], ...] = (
    ["--record", "s.mcap"],
    ["--view", "v.rrd"],
    ["--panel"],
)


@pytest.mark.process
@pytest.mark.realtime
@pytest.mark.parametrize("options", OPTIONS, ids=lambda options: options[0])
def test_files_of_the_working_directory_are_not_imported(options: list[str], tmp_path: Path) -> None:
    if options[0] == "--view" and find_spec("rerun") is None:
        pytest.skip("needs the extra contid[view]")
    other = tmp_path / "contid"
    other.mkdir()
    for name in ("contid/__init__.py", "queue.py", "numpy.py"):
        (tmp_path / name).write_text("raise SystemExit('a file of the working directory was imported')\n")
    (tmp_path / "rows.csv").write_text(ROWS)
    socket = tmp_path / "s"
    done = subprocess.run(
        [
            *(sys.executable, "-P", "-m", "contid", "run", "finger", "--mock", "--trajectory", "rows.csv"),
            *("--socket", str(socket), *options),
        ],
        cwd=tmp_path, capture_output=True, text=True, timeout=100, stdin=subprocess.DEVNULL, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "working directory" not in done.stderr
    if options[0] != "--panel":
        assert (tmp_path / options[1]).exists()


def test_a_checkout_that_is_not_installed_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert module_command("contid.control.process", "3")[1:] == ["-P", "-m", "contid.control.process", "3"]
    monkeypatch.chdir(Path(contid.__file__).parents[1])
    assert module_command("contid", "panel")[1:] == ["-m", "contid", "panel"]


def test_a_working_directory_may_be_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert "-P" in module_command("contid")
