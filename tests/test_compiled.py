"""What workers find compiled (support/plugins/compiled.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.plugins.compiled import compile_files, not_compiled


@pytest.mark.process
def test_new_files_are_compiled_and_a_faulty_one_stops_none(tmp_path: Path) -> None:
    texts = ("def test_it() -> None:\n    assert True\n",) * 2
    files = [tmp_path / f"test_{name}.py" for name in ("a", "faulty", "b")]
    for file, text in zip(files, (texts[0], "import none_such\n", texts[1]), strict=True):
        file.write_text(text)
    assert not_compiled(files) == files
    compile_files(files, tmp_path)
    assert not_compiled(files) == []
