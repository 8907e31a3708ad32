"""What a Rerun recording contains, by Rerun's own program."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from contid_view.rerun.program import rerun_program


def entities(path: Path) -> dict[str, int]:
    """Rows of every entity of the recording, without its layout."""
    done = subprocess.run(
        [rerun_program(), "rrd", "print", str(path)], capture_output=True, text=True, check=True, timeout=60
    )
    rows: dict[str, int] = {}
    for count, entity in re.findall(r"with (\d+) rows? .*? - /(\S+) - ", done.stdout):
        rows[entity] = rows.get(entity, 0) + int(count)
    return rows
