"""Small changes of C++ sources, and the text in which every drawn change can be chosen at run time.

A change is an expression that asks whether it is the chosen one (`mutant.hpp`), so that one build has all of
them. What the compiler refuses (as the constant of a template) is left out by `build.py`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

#: Lines in which no expression can ask: directives, declarations of types, constants at compile time.
UNCHANGED: Final = re.compile(
    r"^\s*(#|using\b|template\b|typedef\b|namespace\b|static_assert\b|struct\b)|\bconstexpr\b|\boperator\b|\b_a\b"
)
NUMBER: Final = re.compile(
    r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])|(?<![\w.:])(k[A-Z]\w+)(?!\w)"
)
BINARY: Final = re.compile(r" (<=|>=|<|>|\+|-|\*|/|&&|\|\|) ")
CONDITION: Final = re.compile(r"\bif \(")
STATEMENT: Final = re.compile(r"^(\s*)([\w.:\[\]\->]+(?: (?:=|\+=|-=|\*=) |\()[^{}]*;)\s*$")
#: Words after which a line is no assignment or call.
NO_STATEMENT: Final = re.compile(
    r"^\s*(return|else|for|if|while|do|case|default|break|continue|throw|delete|using)\b"
)
OPENING, CLOSING = "([{", ")]}"


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: bytes ``start`` to ``end`` of a file become ``text``, where ``@`` stands for its number."""

    file: str
    line: int
    start: int
    end: int
    text: str
    kind: str

    @property
    def name(self) -> str:
        """Where it is and what it does."""
        return f"{self.file}:{self.line}:{self.start} {self.kind}"


def mutants(folder: Path) -> list[Mutant]:
    """Every possible change of the kernels' sources in a folder."""
    found = list[Mutant]()
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".cpp", ".hpp"):
            name = str(path.relative_to(folder))
            found += _of_file(name, path.read_text(encoding="utf-8"))
    return found


def mutated(text: str, drawn: list[tuple[int, Mutant]]) -> str:
    """A file with drawn changes, each with its number."""
    # An insertion keeps what it encloses, hence all are insertions of a text before and one after.
    pieces = list[tuple[int, int, str]]()
    for number, mutant in drawn:
        before, _, after = mutant.text.replace("@", str(number)).partition("\0")
        pieces.append((mutant.start, -mutant.end, before))
        pieces.append((mutant.end, mutant.start - len(text), after))
    for at, _, piece in sorted(pieces, key=lambda each: (each[0], each[1]), reverse=True):
        text = text[:at] + piece + text[at:]
    return text


def _of_file(name: str, text: str) -> Iterator[Mutant]:
    code = _without_comments(text)
    lines, offset = code.split("\n"), 0
    for index, line in enumerate(lines):
        if not UNCHANGED.search(line):
            for start, end, change, kind in _of_line(code, offset, line, lines, index):
                yield Mutant(name, index + 1, start, end, change, kind)
        offset += len(line) + 1


def _of_line(
    code: str, offset: int, line: str, lines: list[str], index: int
) -> Iterator[tuple[int, int, str, str]]:
    for found in CONDITION.finditer(line):
        start = offset + found.end()
        end = _extent(code, start, ())
        if not re.search(r"[;{]|[^=!<>]=[^=]", code[start:end]):
            yield start, end, "(\0) != contid_mutants::is(@)", "negated condition"
    for found in BINARY.finditer(line):
        yield from _of_operator(code, offset + found.end(), found[1])
    for found in NUMBER.finditer(line):
        yield offset + found.start(), offset + found.end(), "contid_mutants::more(@, \0)", f"{found[0]} + 1"
    statement = STATEMENT.match(line)
    before = next((each.rstrip() for each in reversed(lines[:index]) if each.strip()), "{")
    after = next((each.strip() for each in lines[index + 1 :] if each.strip()), "}")
    if (
        statement
        and not NO_STATEMENT.match(line)
        and before[-1] in ";{}"
        and not after.startswith("else")
        and line.count("(") == line.count(")")
        and line.count(";") == 1
    ):
        start = offset + statement.start(2)
        yield start, offset + statement.end(2), "if (!contid_mutants::is(@)) \0", "statement left out"


def _of_operator(code: str, start: int, operator: str) -> Iterator[tuple[int, int, str, str]]:
    """A change of the right operand that has the effect of another operator."""
    if operator in ("+", "-"):
        yield start, start, "contid_mutants::sign(@) * \0", f"{operator} with the other sign"
    elif operator in ("*", "/"):
        yield start, start, f"contid_mutants::factor(@) {operator} \0", f"{operator} 2 {operator}"
    elif operator in ("&&", "||"):
        end = _extent(code, start, ("&&", "||", "?") if operator == "&&" else ("||", "?"))
        wrap = "(contid_mutants::is(@) || (\0))" if operator == "&&" else "(!contid_mutants::is(@) && (\0))"
        yield start, end, wrap, f"{operator} without its right operand"
    else:
        end = _extent(code, start, ("&&", "||", "?", ":", "<", ">", "==", "!=", "="))
        direction = {"<": 1, "<=": -1, ">": -1, ">=": 1}[operator]
        other = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}[operator]
        yield start, end, f"contid_mutants::edge(@, {direction}, \0)", f"{operator} becomes {other}"


def _extent(code: str, start: int, ends: tuple[str, ...]) -> int:
    """Where an operand that begins at ``start`` ends: before the bracket, comma or operator around it."""
    depth, at = 0, start
    while at < len(code):
        each = code[at]
        if each in OPENING:
            depth += 1
        elif each in CLOSING:
            depth -= 1
            if depth < 0:
                return at
        elif depth == 0:
            if each in ",;":
                return at
            if each == " " and any(code.startswith(f" {end} ", at) for end in ends):
                return at
        at += 1
    return at


def _without_comments(text: str) -> str:
    """The same text, with blanks for comments and the insides of strings."""

    def blank(found: re.Match[str]) -> str:
        return (
            re.sub(r"[^\n]", " ", found[0]) if found[0][0] == "/" else '"' + "_" * (len(found[0]) - 2) + '"'
        )

    return re.sub(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"', blank, text, flags=re.DOTALL)
