"""Expressions of a mapping: numbers, columns, ``+ - * /``, comparisons and a few functions.

They are parsed here and computed on columns; nothing of them is ever run as Python.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from contid.errors import BadInputError, ContidError
from contid_adapt.reading.table import Table, TableColumn

Floats: TypeAlias = NDArray[np.float64]

MAX_LENGTH: Final = 500
_MAX_DEPTH: Final = 30
_TOKEN: Final = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?![\w.])"
    r"|(?P<name>[A-Za-z_][\w.]*(?:\[\d+\](?:\.[A-Za-z_]\w*)*)*)|`(?P<quoted>[^`]+)`"
    r"|(?P<text>'[^']*'|\"[^\"]*\")|(?P<sign>==|!=|<=|>=|[-+*/()<>]))"
)


def _wrap32(values: Floats) -> Floats:
    steps = np.diff(values)
    return values + np.concatenate(([0.0], np.cumsum(-np.round(steps / 2**32)))) * 2.0**32


FUNCTIONS: Final[Mapping[str, Callable[[Floats], Floats]]] = {
    "sqrt": np.sqrt, "abs": np.abs, "sin": np.sin, "cos": np.cos, "tan": np.tan,
    "deg": np.degrees, "rad": np.radians, "first": lambda values: np.full_like(values, values[0]),
    "unwrap_deg": lambda values: np.unwrap(values, period=360.0), "unwrap_rad": np.unwrap, "wrap32": _wrap32,
}  # fmt: skip
#: Functions that multiply or add a constant, for the check of units.
_LINEAR: Final = {
    "deg": 180.0 / math.pi,
    "rad": math.pi / 180.0,
    "unwrap_deg": 1.0,
    "unwrap_rad": 1.0,
    "wrap32": 1.0,
}


@dataclass(frozen=True, slots=True)
class ExpressionNode:
    """One step of an expression: ``kind`` is number, name, text, a sign, "neg" or the name of a function."""

    kind: str
    value: float | str = 0.0
    parts: tuple[ExpressionNode, ...] = ()


@dataclass(frozen=True, slots=True)
class Affine:
    """``constant + sum of factor * column``."""

    constant: float
    factors: dict[str, float]


class _Parser:
    """Recursive descent with one token ahead."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[tuple[str, str, int]] = []
        place = 0
        if len(text) > MAX_LENGTH:
            raise ContidError(f"an expression has at most {MAX_LENGTH} characters")
        while place < len(text.rstrip()):
            found = _TOKEN.match(text, place)
            if not found or not found.lastgroup:
                raise ContidError(f"{text!r}: {text[place:].strip()[:12]!r} is not understood")
            self.tokens.append((found.lastgroup, found[found.lastgroup], place + 1))
            place = found.end()
        self.at = 0

    def sign(self) -> str:
        kind, text, _ = self.tokens[self.at] if self.at < len(self.tokens) else ("", "", 0)
        word = kind == "name" and text in ("and", "or")
        return text if kind == "sign" or word else ""

    def whole(self) -> ExpressionNode:
        node = self.levels(0)
        if self.at < len(self.tokens):
            raise ContidError(f"{self.text!r}: {self.tokens[self.at][1]!r} is not expected there")
        return node

    def levels(self, level: int, depth: int = 0) -> ExpressionNode:
        """Binary signs, the weakest first."""
        signs = (("or",), ("and",), ("==", "!=", "<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
        if depth > _MAX_DEPTH:
            raise ContidError(f"{self.text[:40]!r}: nested too deeply")
        if level == len(signs):
            return self.unit(depth)
        node = self.levels(level + 1, depth)
        while (sign := self.sign()) in signs[level] and sign:
            self.at += 1
            node = ExpressionNode(sign, 0.0, (node, self.levels(level + 1, depth)))
        return node

    def unit(self, depth: int) -> ExpressionNode:
        if self.at >= len(self.tokens):
            raise ContidError(f"{self.text!r} ends too early")
        kind, text, place = self.tokens[self.at]
        self.at += 1
        if kind == "sign" and text in "+-":
            if depth > _MAX_DEPTH:
                raise ContidError(f"{self.text[:40]!r}: nested too deeply")
            inner = self.unit(depth + 1)
            return ExpressionNode("neg", 0.0, (inner,)) if text == "-" else inner
        if kind == "number":
            return ExpressionNode("number", float(text))
        if kind == "text":
            return ExpressionNode("text", text[1:-1])
        if text == "(" or (kind == "name" and self.sign() == "("):
            self.at += text != "("
            inner = self.levels(0, depth + 1)
            if self.sign() != ")":
                raise ContidError(f"{self.text!r}: a closing bracket is missing")
            self.at += 1
            if text != "(" and text not in FUNCTIONS:
                raise ContidError(f"{self.text!r}: no function {text!r}; allowed: {', '.join(FUNCTIONS)}")
            return inner if text == "(" else ExpressionNode(text, 0.0, (inner,))
        if kind in ("name", "quoted") and text not in ("and", "or"):
            return ExpressionNode("name", text)
        raise ContidError(f"{self.text!r}: {text!r} at {place} is not expected there")


def parse(text: str) -> ExpressionNode:
    """Parse an expression.

    Raises:
        ContidError: it is none.
    """
    return _Parser(text).whole()


def names_in(node: ExpressionNode) -> list[str]:
    """The columns that an expression uses."""
    own = [str(node.value)] if node.kind == "name" else []
    return own + [name for part in node.parts for name in names_in(part)]


def affine(node: ExpressionNode) -> Affine | None:
    """The factors of an expression that is linear in its columns, or None."""
    if node.kind == "number":
        return Affine(float(node.value), {})
    if node.kind == "name":
        return Affine(0.0, {str(node.value): 1.0})
    parts = [affine(part) for part in node.parts]
    if not parts or any(part is None for part in parts):
        return None
    one, other = parts[0], parts[-1]
    assert one is not None
    assert other is not None
    if node.kind == "neg" or node.kind in _LINEAR:
        return _scaled(one, -1.0 if node.kind == "neg" else _LINEAR[node.kind])
    if node.kind in ("+", "-"):
        second = _scaled(other, 1.0 if node.kind == "+" else -1.0)
        factors = dict(one.factors)
        for name, factor in second.factors.items():
            factors[name] = factors.get(name, 0.0) + factor
        return Affine(one.constant + second.constant, factors)
    if node.kind == "*" and not (one.factors and other.factors):
        return _scaled(other, one.constant) if not one.factors else _scaled(one, other.constant)
    if node.kind == "/" and not other.factors and other.constant:
        return _scaled(one, 1.0 / other.constant)
    return None


def _scaled(form: Affine, factor: float) -> Affine:
    return Affine(form.constant * factor, {name: each * factor for name, each in form.factors.items()})


def numbers_of(table: Table, name: str) -> TableColumn:
    """A column of numbers.

    Raises:
        BadInputError: unknown, of words, or with a cell that is no number.
    """
    column = table.column(name)
    if column.is_text:
        raise BadInputError([table.at(0, column, f"column {name!r} has text, not numbers")])
    if column.bad:
        raise BadInputError([
            table.at(row, column, f"{name}: {cell[:40]!r} is not a number") for row, cell in column.bad[:20]
        ])  # fmt: skip
    return column


def evaluate(node: ExpressionNode, table: Table) -> Any:
    """The values of an expression, shape ``(rows,)``; comparisons give booleans.

    Raises:
        BadInputError: see `numbers_of`.
    """
    if node.kind == "number":
        return np.full(len(table), float(node.value))
    if node.kind == "name":
        return numbers_of(table, str(node.value)).values.astype(float)
    if node.kind in FUNCTIONS:
        with np.errstate(invalid="ignore", over="ignore"):
            return FUNCTIONS[node.kind](evaluate(node.parts[0], table))
    if node.kind == "text":
        raise ContidError(f"{node.value!r}: a word can only be compared with == or != to a column")
    if node.kind in ("==", "!=") and any(part.kind == "text" for part in node.parts):
        name, text = sorted(node.parts, key=lambda part: part.kind == "text")
        column = table.column(str(name.value))
        same = np.array([str(each) == text.value for each in column.values])
        return same if node.kind == "==" else ~same
    values = [evaluate(part, table) for part in node.parts]
    if node.kind == "neg":
        return -values[0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return _BINARY[node.kind](*values)


_BINARY: Final[Mapping[str, Callable[[Any, Any], Any]]] = {
    "+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide, "==": np.equal, "!=": np.not_equal,
    "<": np.less, ">": np.greater, "<=": np.less_equal, ">=": np.greater_equal,
    "and": np.logical_and, "or": np.logical_or,
}  # fmt: skip
