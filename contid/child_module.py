"""Command lines of child processes that run another module of this package."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path


def module_command(module: str, *arguments: str) -> list[str]:
    """The command that runs a module in the interpreter, and from the package, of this process.

    ``python -m`` looks in the working directory first. A checkout there has no compiled kernels, and a script
    there may have the name of a module of the standard library; neither is what this process imported.
    """
    safe_path = [] if _in_working_directory() else ["-P"]
    return [sys.executable, *safe_path, "-m", module, *arguments]


def _in_working_directory() -> bool:
    """True for a package that is perhaps found nowhere else: a checkout that is not installed."""
    with suppress(FileNotFoundError):  # a working directory that was removed
        return Path(__file__).parents[1] == Path.cwd()
    return False
