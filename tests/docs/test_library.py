"""Every ``python`` block of docs/library.md runs as it is printed, in order, from an empty directory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent


def test_the_page_begins_with_what_to_do() -> None:
    heading, first = (ROOT / "docs" / "library.md").read_text().splitlines()[:2]
    assert heading.startswith("# ")
    assert first.startswith("Load ")


def test_the_examples_run_in_order(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "library.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    script = tmp_path / "page.py"
    script.write_text("\n".join(blocks))
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=tmp_path,
        env={
            **os.environ,
            "MPLBACKEND": "Agg",
            "XDG_RUNTIME_DIR": str(tmp_path),
            "PYTHONPATH": os.pathsep.join(
                [str(ROOT), str(ROOT / "drivers"), os.environ.get("PYTHONPATH", "")]
            ),
        },
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    # What the comments of the page print.
    for printed in ("(3, 6)", "[ True  True False]", "('left', 'right')", "(2, 21, 3)"):
        assert printed in done.stdout
    assert "tips has shape (1, 2); expected: (3,) or (N, 3) with columns x_mm, y_mm, z_mm" in done.stdout
