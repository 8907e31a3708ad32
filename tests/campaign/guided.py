"""``python -m tests.campaign.guided TARGET SECONDS [--keep]``: the bad input campaign, guided by coverage.

Begins with the good inputs and the stored ones (``tests/campaign/corpus``). A finding ends the run with its
traceback and leaves the input in ``crash-*``. ``--keep`` stores inputs that take new ways through the code.
Needs atheris from PyPI (``pip install atheris``), which is no dependency of contid.
"""

from __future__ import annotations

import gc
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from types import FunctionType

from tests.campaign.corpus import keep

FUZZ = "fuzz"
PACKAGES = ("contid", "contid_drivers", "yaml", "mcap")


def fuzz(name: str, arguments: list[str]) -> None:
    """One run of libFuzzer, which ends the process."""
    import atheris

    from contid.errors import ContidError
    from tests.campaign.bad_input import TARGETS, corpus

    with suppress(ContidError):
        TARGETS[name](corpus(name)[0])  # imports what it needs
    # After the imports: the finder of an editable installation is not instrumented by `instrument_imports`.
    for function in [each for each in gc.get_objects() if isinstance(each, FunctionType)]:
        if (function.__module__ or "").partition(".")[0] in PACKAGES:
            atheris.instrument_func(function)

    def one(data: bytes) -> None:
        with suppress(ContidError):
            TARGETS[name](data)

    atheris.Setup([sys.argv[0], *arguments, "-rss_limit_mb=4096"], one)
    atheris.Fuzz()


def main(name: str, seconds: str, store: bool) -> int:
    """Fuzz, and keep what is new."""
    from tests.campaign.bad_input import attempt, corpus

    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(corpus(name)):
            Path(folder, str(number)).write_bytes(data)
        limits = [f"-max_total_time={seconds}", "-max_len=65536"]
        again = [sys.executable, "-m", "tests.campaign.guided", FUZZ, name]
        status = subprocess.run([*again, folder, *limits]).returncode
        if store and not status:
            found = [path.read_bytes() for path in Path(folder).iterdir()]
            print(keep(name, corpus(name), found, lambda data: attempt(name, data)), "inputs stored")
    return status


if __name__ == "__main__":
    if sys.argv[1] == FUZZ:
        fuzz(sys.argv[2], sys.argv[3:])
    else:
        sys.exit(main(sys.argv[1], sys.argv[2], "--keep" in sys.argv))
