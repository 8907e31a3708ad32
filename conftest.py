"""What every test folder uses, tests/ and the tests of extras: plug-ins in tests/support/plugins."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

import contid
from contid import kernels
from contid.errors import ContidError

ROOT = Path(__file__).parent

pytest_plugins = (
    "tests.support.plugins.isolation",
    "tests.support.plugins.tiers",
    "tests.support.plugins.workers",
    "tests.support.plugins.budget",
    "tests.support.plugins.order",
    "tests.support.plugins.reruns",
    "tests.support.plugins.commands",
    "tests.support.plugins.parsed",
)
# As `contid` itself: threads of a linear-algebra library wait for one another by spinning, which took two
# thirds of the processor time of a fit on two busy cores. numpy reads it when it is imported, which is later.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
# Tests with rewritten assertions are compiled once and kept, whatever the environment says.
sys.dont_write_bytecode = False


def pytest_configure() -> None:
    """Refuse to test another tree, which an editable installation may belong to, or one without kernels."""
    if not Path(contid.__file__).is_relative_to(ROOT):
        raise pytest.UsageError(
            f"contid is imported from {Path(contid.__file__).parent}, these are the tests of {ROOT}; "
            f"run '{sys.executable} -m pip install -e {ROOT}', or use the Python of a .venv in it"
        )
    try:
        kernels.require()
    except ContidError as error:
        raise pytest.UsageError(str(error)) from error
