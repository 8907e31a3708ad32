"""``python -m tests.campaign.guided TARGET SECONDS``: the bad input campaign, guided by coverage.

Needs atheris from PyPI (``pip install atheris``), which is no dependency of contid. A finding ends the run
with its traceback and leaves the input in ``crash-*``.
"""

from __future__ import annotations

import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["contid", "contid_drivers", "yaml"]):
    from contid.errors import ContidError
    from tests.campaign.bad_input import TARGETS, corpus


def main(name: str, seconds: str) -> None:
    def one(data: bytes) -> None:
        with suppress(ContidError):
            TARGETS[name](data)

    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(corpus(name)):
            (Path(folder) / str(number)).write_bytes(data)
        limits = [f"-max_total_time={seconds}", "-rss_limit_mb=4096", "-max_len=65536"]
        atheris.Setup([sys.argv[0], folder, *limits], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main(*sys.argv[1:])
