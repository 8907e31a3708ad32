"""Only `realtime` tests are tried again, and only up to the rate that CI allows."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent
#: Helpers that start daemons, which keep to the clock of this machine.
DAEMONS = re.compile(r"^from tests\.support\.(daemons|fleets|panels) import", re.MULTILINE)
#: Of all that are installed, what is needed: each try imports them in every process.
PLUGINS = ("-p", "no:cacheprovider", "-p", "xdist", "-p", "pytest_rerunfailures")
HOOKS = """\
from tests.support.plugins.reruns import (
    pytest_collection_modifyitems, pytest_sessionfinish, pytest_terminal_summary,
)
"""
UNSTEADY = """
import pytest

tries = []

{mark}
def test_unsteady():
    tries.append(1)
    assert len(tries) > 1

@pytest.mark.parametrize("number", range(9))
def test_steady(number):
    pass
"""


@pytest.mark.parametrize(
    ("mark", "rate", "workers", "code"),
    [
        ("@pytest.mark.realtime", None, (), 0),
        ("@pytest.mark.realtime", "0.11", ("-n", "1"), 0),
        ("@pytest.mark.realtime", "0.09", ("-n", "1"), 1),
        ("", "0.11", (), 1),
        *(
            pytest.param(*case, marks=pytest.mark.campaign)
            for case in (
                ("@pytest.mark.realtime", None, ("-n", "1"), 0),
                ("@pytest.mark.realtime", "0.11", (), 0),
                ("@pytest.mark.realtime", "0.09", (), 1),
                ("", "0.11", ("-n", "1"), 1),
            )
        ),
    ],
)
def test_reruns(mark: str, rate: str | None, workers: tuple[str, ...], code: int, tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(HOOKS)
    (tmp_path / "test_unsteady.py").write_text(UNSTEADY.format(mark=mark))
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  realtime: as in contid\n")
    environment = {
        key: value for key, value in os.environ.items() if not key.startswith(("CONTID_", "PYTEST_"))
    }
    environment["PYTHONPATH"] = str(ROOT)
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    if rate is not None:
        environment["CONTID_MAX_RERUN_RATE"] = rate
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", *PLUGINS, *workers],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    named = "RERUN test_unsteady.py::test_unsteady - assert 1 > 1" in done.stdout
    assert named == bool(mark), done.stdout


def test_tests_of_daemons_are_realtime() -> None:
    """One test that a standing machine fails and that is not tried again refuses a whole run of CI."""
    files = [path for path in sorted((ROOT / "tests").rglob("test_*.py")) if DAEMONS.search(path.read_text())]
    assert files
    assert [str(path) for path in files if "pytest.mark.realtime" not in path.read_text()] == []
