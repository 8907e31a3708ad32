"""Ctrl-C while the command imports ends it without a traceback."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

SCRIPT = """
import os, signal, sys
module = sys.argv[1]
sys.argv[1:] = ["check", "finger"]

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == module:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
from contid.entry import main
main()
"""


@pytest.mark.parametrize("module", ["contid.cli.main", "click", "contid.cli.commands.check", "pydantic"])
def test_an_interrupt_during_an_import_is_quiet(module: str) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT, module], capture_output=True, text=True)
    assert (done.returncode, done.stderr.strip()) == (130, "")
