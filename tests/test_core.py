"""The core imports no extra: neither at its top, nor inside a function, nor for types."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
EXTRAS = {path.name for path in ROOT.glob("extras/*/contid_*")}


def imported(tree: ast.AST) -> Iterator[str]:
    """First parts of the modules that the statements of a file, and texts that name a module, import."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]
        elif isinstance(node, ast.Import):
            yield from (each.name.partition(".")[0] for each in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value.partition(":")[0].partition(".")[0]  # for import_module and `python -m`


def test_the_core_imports_no_extra() -> None:
    files = [path for top in ("contid", "drivers") for path in sorted((ROOT / top).rglob("*.py"))]
    found = {
        path.relative_to(ROOT).as_posix(): names
        for path in files
        if (names := EXTRAS.intersection(imported(ast.parse(path.read_text(encoding="utf-8")))))
    }
    assert len(files) > 300
    assert len(EXTRAS) > 0
    assert not found


def test_every_way_to_import_is_seen() -> None:
    code = """
import contid_a.x
from contid_b.y import z
def f():
    if TYPE_CHECKING:
        from contid_c import d
    import_module("contid_d.e")
"""
    assert {"contid_a", "contid_b", "contid_c", "contid_d"} <= set(imported(ast.parse(code)))
