"""Lint, format, types and layers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

ROOT = Path(__file__).parent.parent
#: The product: half of what `mypy` alone checks, which has the tests, the studies and the examples as well.
PRODUCT = ["contid", "drivers/contid_drivers", *map(str, sorted(ROOT.glob("extras/*/contid_*")))]


@pytest.mark.timeout(900)  # mypy without its cache, on a busy machine
@pytest.mark.parametrize(
    "command",
    [
        ["ruff", "check", "."],
        ["ruff", "format", "--check", "."],
        ["mypy", *PRODUCT],
        pytest.param(["mypy"], marks=pytest.mark.campaign),
        ["lint-imports", "--no-cache"],
    ],
    ids=["ruff", "format", "mypy of the product", "mypy", "layers"],
)
def test_checks_pass(command: list[str]) -> None:
    tool = Path(sys.executable).parent / command[0]
    folders = [ROOT, ROOT / "drivers", *sorted(ROOT.glob("extras/*"))]
    path = os.pathsep.join([*map(str, folders), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [str(tool), *command[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_kernels_and_firmware_are_formatted() -> None:
    """By .clang-format at the root, which the host's editor reads too."""
    tool = Path(sys.executable).parent / "clang-format"
    files = [
        str(path)
        for folder in ("contid", "firmware", "tests")
        for path in sorted((ROOT / folder).rglob("*"))
        if path.suffix in {".cpp", ".hpp", ".h", ".ino"}
    ]
    done = subprocess.run([str(tool), "--dry-run", "-Werror", *files], capture_output=True, text=True)
    assert files
    assert done.returncode == 0, done.stderr[-2000:]
