"""Ctrl-C while the command imports ends it without a traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.process

SCRIPT = """
import os, signal, sys
module = sys.argv[1]
sys.argv[1:] = sys.argv[2:]

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
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, module, "check", "finger"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr.strip()) == (130, "")


def test_an_interrupt_of_which_compiled_code_made_an_error_is_quiet() -> None:
    """pydantic showed one as a `SchemaError`, with its traceback and exit code 1."""
    code = """
import contid.cli.main, contid.entry, pydantic_core

class Interrupted:
    def __repr__(self):
        raise KeyboardInterrupt

values = {"type": "literal", "expected": [Interrupted()]}
contid.cli.main.main = lambda: pydantic_core.SchemaValidator(values)
contid.entry.main()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr.strip()) == (130, "")


def test_the_end_of_stdin_at_a_question_of_bringup_is_named() -> None:
    """At the questions about gauge and dump valve it was taken for Ctrl-C: exit code 130, no message."""
    code = """
import sys
import contid.cli.main
from contid_bringup.command import Person
contid.cli.main.cli.main = lambda **_: Person().dumped("arm.p1", lambda: None)
contid.cli.main.main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "stdin ended where an answer was expected" in done.stderr


def test_a_run_as_a_background_job_of_a_script_loses_no_interrupt(tmp_path: Path) -> None:
    """Shells start such jobs with SIGINT ignored; it came before the handlers of the run, and was lost."""
    arguments = ["contid.remote.server.server", "run", "finger", "--mock", "--socket", str(tmp_path / "s")]
    done = subprocess.run(
        ["sh", "-c", 'trap "" INT; exec "$@"', "sh", sys.executable, "-c", SCRIPT, *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr.strip()) == (130, "")
