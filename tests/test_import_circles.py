"""No modules import each other in a circle, imports inside functions and for types alone counted."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: Folders whose packages are looked at, with the packages in them.
SOURCES = {ROOT: "contid", ROOT / "drivers": "contid_drivers"}


def modules() -> dict[str, Path]:
    found = {}
    for folder, package in SOURCES.items():
        for path in (folder / package).rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imported(path: Path, known: dict[str, Path]) -> Iterator[str]:
    """Modules that a file names in any import, wherever it stands."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for each in node.names:
                whole = f"{node.module}.{each.name}"
                if (name := whole if whole in known else node.module) in known:
                    yield name


@pytest.mark.parametrize("package", ["contid.control", "contid.remote", "contid_drivers"])
def test_no_module_of_a_package_is_in_a_circle(package: str) -> None:
    known = modules()
    graph = {name: {*imported(path, known)} - {name} for name, path in known.items()}
    inside = {name: needs for name, needs in graph.items() if f"{name}.".startswith(f"{package}.")}
    assert len(inside) > 20
    try:
        TopologicalSorter(inside).prepare()
    except CycleError as error:
        pytest.fail(f"{' -> '.join(error.args[1])}")
