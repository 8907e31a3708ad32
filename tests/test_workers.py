"""Workers that fork from a process which has imported the tests (support/plugins/workers.py)."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
#: Where it is imported, what a worker must not have of it, and the process that it is a fork of.
GOOD = """
import os
import sys
from pathlib import Path

imported_by = os.getpid()


def test_it() -> None:
    assert os.getppid() == imported_by
    assert sys.modules["__main__"].__spec__ is None
    numbers = [1, 2]
    assert numbers == [1, 3]
"""


@pytest.mark.process
@pytest.mark.slow
def test_workers_have_what_was_imported_once_and_report_what_cannot_be(tmp_path: Path) -> None:
    texts = {
        "good": GOOD,
        "faulty": "import none_such\n",
        "without": "import pytest\npytest.importorskip('none')\n",
    }
    files = [tmp_path / f"test_{name}.py" for name in texts]
    for file, text in zip(files, texts.values(), strict=True):
        file.write_text(text)
    command = [sys.executable, "-m", "pytest", "-n", "2", "-q", "-p", "no:cacheprovider", "-k", "test_it"]
    done = subprocess.run(
        [*command, "--continue-on-collection-errors", *map(str, files), "tests/test_order.py"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "assert [1, 2] == [1, 3]" in done.stdout  # rewritten, and nothing before it failed
    assert "No module named 'none_such'" in done.stdout
    assert "could not import 'none'" in done.stdout
    assert "1 failed, 1 skipped, 1 error" in done.stdout


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.campaign
def test_workers_import_tests_themselves_where_a_fork_would_lack_a_thread(tmp_path: Path) -> None:
    file = tmp_path / "test_threads.py"
    start = "threading.Thread(target=time.sleep, args=(60.0,), daemon=True).start()"
    file.write_text(f"import threading\nimport time\n\n{start}\n\n\ndef test_it() -> None:\n    pass\n")
    done = subprocess.run(
        [
            sys.executable, "-m", "pytest", "-n", "2", "-q", "-p", "no:cacheprovider", "-k", "test_it",
            str(file), "tests/test_order.py",
        ],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "importing the tests starts threads" in done.stderr
    assert "1 passed" in done.stdout
