"""What a module evaluates inside functions and what at its import, and the names that connect the two."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

_Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass
class Names:
    """Of one module.

    Attributes:
        inside: by line inside functions, first and last line of the statement that it is part of.
        defined: by other lines, the names that are defined there.
        owner: by line inside functions, the name of the function or class at the top of the module.
        used: by name, lines inside functions where it occurs.
        made: by name, the names at the top whose value it goes into.
    """

    inside: dict[int, tuple[int, int]] = field(default_factory=dict)
    defined: dict[int, set[str]] = field(default_factory=lambda: defaultdict(set))
    owner: dict[int, str] = field(default_factory=dict)
    used: dict[str, set[int]] = field(default_factory=lambda: defaultdict(set))
    made: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))


def names_of(text: str) -> Names:
    """Of the text of a module."""
    found = Names()
    for statement in ast.parse(text).body:
        names = set(_targets(statement))
        for line in range(statement.lineno, (statement.end_lineno or 0) + 1):
            found.defined[line] |= names
        for node, function in _nodes(statement, ""):
            if function:
                if isinstance(node, ast.stmt):
                    _mark(found, node, next(iter(names), ""))
            elif isinstance(node, _Function):  # defaults of its arguments
                for line in range(node.lineno, node.body[0].lineno):
                    found.defined[line] = {node.name}
            for name in _occurring(node):
                if function:
                    found.used[name].add(node.lineno)  # type: ignore[attr-defined]
                else:
                    found.made[name] |= names - {name}
    return found


def _nodes(node: ast.AST, function: str) -> Iterator[tuple[ast.AST, str]]:
    """A node and all below it, with the function in whose body each is, "" for none."""
    yield node, function
    for part, value in ast.iter_fields(node):
        inner = node.name if isinstance(node, _Function) and part == "body" else function
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _nodes(child, inner)


def _mark(found: Names, node: ast.stmt, owner: str) -> None:
    body = getattr(node, "body", None)
    last = max(node.lineno, body[0].lineno - 1) if body else node.end_lineno or node.lineno
    for line in range(node.lineno, last + 1):
        found.inside[line] = (node.lineno, last)
        found.owner[line] = owner


def _targets(statement: ast.stmt) -> Iterator[str]:
    if isinstance(statement, _Function | ast.ClassDef):
        yield statement.name
    elif isinstance(statement, ast.Assign | ast.AnnAssign):
        for target in statement.targets if isinstance(statement, ast.Assign) else [statement.target]:
            yield from (node.id for node in ast.walk(target) if isinstance(node, ast.Name))


def _occurring(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Attribute):
        yield node.attr
