"""A YAML document with the line and column of every key and value.

Read from the parser's events: scalars follow the YAML 1.2 core schema (``1e-3`` is a number, ``on`` is text);
tags, duplicate keys, deep nesting and multiplying aliases are findings. A mistake inside an aliased value is
located once, where it was written.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Final, TypeAlias

import yaml

from contid.errors import BadInputError, ContidError, Located, first_findings

#: KeyPath in a document: keys of mappings and indices of sequences from the root.
KeyPath: TypeAlias = tuple[str | int, ...]
Data: TypeAlias = "str | int | float | bool | list[Data] | dict[str, Data] | None"

#: Far beyond any robot file; they bound time and memory for a wrong one.
MAX_CHARACTERS: Final = 1_000_000
#: A character of UTF-8 takes at most four bytes.
_MAX_BYTES: Final = 4 * MAX_CHARACTERS
MAX_DEPTH: Final = 32
MAX_VALUES: Final = 50_000
MAX_INVISIBLE: Final = 100
#: What to do about a problem that PyYAML names.
_REMEDIES: Final = {
    "'\\t' that cannot": "; indent with spaces",
    "expected <block end>": "; indent this line as its neighbours, by spaces",
    "mapping values are not allowed": "; quote a value that has a colon, and check the indentation",
}
#: Not printable, and allowed: tab, line feed, joiners of scripts and emoji.
_ALLOWED: Final = "\t\n\u200c\u200d"

_INTEGER: Final = re.compile(r"[-+]?[0-9]+")
_FLOAT: Final = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_CONSTANTS: Final[dict[str, bool | float | None]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + dot: float(sign + "inf") for sign in ("", "+", "-") for dot in (".inf", ".Inf", ".INF")},
}


@dataclass(slots=True)
class Document:
    """A parsed document: plain data, and positions by path.

    Attributes:
        file: its name in messages.
        data: mappings, sequences and scalars as Python values.
        keys, values: line and column, from 1, of the key and of the value at a path.
    """

    file: str
    data: Data = None
    keys: dict[KeyPath, tuple[int, int]] = field(default_factory=dict)
    values: dict[KeyPath, tuple[int, int]] = field(default_factory=dict)

    def at_key(self, path: KeyPath, message: str) -> Located:
        """A finding at the key of ``path``, or at its nearest parent in the text."""
        return self._located(path, message, (self.keys, self.values))

    def at_value(self, path: KeyPath, message: str) -> Located:
        """A finding at the value of ``path``, or at its nearest parent in the text."""
        return self._located(path, message, (self.values, self.keys))

    def get(self, path: KeyPath) -> Data:
        """The data at ``path``; None when nothing is there."""
        data = self.data
        for step in path:
            below = step_into(data, step)
            if not below:
                return None
            data = below[0]
        return data

    def _located(
        self, path: KeyPath, message: str, tables: tuple[dict[KeyPath, tuple[int, int]], ...]
    ) -> Located:
        while True:
            for table in tables:
                if path in table:
                    return Located(self.file, *table[path], message)
            if not path:
                return Located(self.file, 1, 1, message)
            path, tables = path[:-1], (self.keys, self.values)


def read_text(path: Path) -> str:
    """The text of a file, with lines that end in a line feed.

    Raises:
        BadInputError: not UTF-8, with the place; longer than any robot file.
        ContidError: the file cannot be read.
    """
    return decoded(read_raw(path), path)


def read_raw(path: Path) -> bytes:
    """The bytes of a file, one beyond the most that a robot file has where it is longer.

    Raises:
        ContidError: the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(_MAX_BYTES + 1)  # devices and pipes have no end
    except OSError as error:
        raise ContidError(f"{path}: cannot read it: {error.strerror}") from error


def decoded(raw: bytes, path: Path) -> str:
    """The text of bytes, with lines that end in a line feed.

    Raises:
        BadInputError: not UTF-8, with the place; longer than any robot file.
    """
    if len(raw) > _MAX_BYTES:
        message = f"more than {_MAX_BYTES} bytes; a robot file has at most {MAX_CHARACTERS} characters"
        raise BadInputError([Located(str(path), 1, 1, message)])
    try:
        return raw.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        column = error.start - raw.rfind(b"\n", 0, error.start)
        message = f"byte 0x{raw[error.start]:02x} is not UTF-8 text; save the file as UTF-8"
        raise BadInputError([Located(str(path), line, column, message)]) from error


def read_document(text: str, file: str) -> Document:
    """Parse ``text``.

    Raises:
        BadInputError: not YAML, tags, duplicate keys, too deep or too large; every finding.
    """
    if len(text) > MAX_CHARACTERS:
        message = f"{len(text)} characters; a robot file has at most {MAX_CHARACTERS}"
        raise BadInputError([Located(file, 1, 1, message)])
    if found := list(islice(_invisible(text, file), MAX_INVISIBLE)):
        raise BadInputError(found)
    reader = _Reader(Document(file))
    try:
        reader.read(iter(yaml.parse(text, Loader=yaml.BaseLoader)))
    except yaml.MarkedYAMLError as error:
        mark, begin = error.problem_mark, error.context_mark
        # A text without its closing quote, or a key without its colon, shows where another line begins.
        if mark is None or (
            isinstance(error, yaml.scanner.ScannerError) and begin and begin.line < mark.line
        ):
            mark = begin
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        what = " ".join(part for part in (error.context, error.problem) if part)
        remedy = next((text for part, text in _REMEDIES.items() if part in what), "")
        reader.findings.append(Located(file, line, column, f"not YAML: {what}{remedy}"))
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        column = error.position - (text.rfind("\n", 0, error.position) + 1) + 1
        reader.findings.append(Located(file, line, column, f"not text: {error.reason}"))
    if reader.findings:
        raise BadInputError(first_findings(reader.findings))
    return reader.document


def invisible(text: str) -> str:
    """The first character that a reader cannot see and that changes what is read, as a text; "" for none.

    Control characters but tab and line feed, marks that turn the direction of writing (U+202E and others),
    line separators, zero-width spaces. Joiners of scripts and emoji are allowed.
    """
    found = next((each for each in text if _is_invisible(each)), "")
    return f"U+{ord(found):04X} ({unicodedata.name(found, 'control character').lower()})" if found else ""


def _is_invisible(character: str) -> bool:
    return not (character.isprintable() or character in _ALLOWED) and (
        unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zl", "Zp")
    )


def _invisible(text: str, file: str) -> Iterator[Located]:
    """Invisible characters of a text, in comments as well: one finding a line."""
    if text.isascii():
        return  # the parser refuses control characters, with their places
    for number, line in enumerate(text.removeprefix("\ufeff").split("\n"), 1):
        if line.isprintable():
            continue
        found = [at for at, each in enumerate(line) if _is_invisible(each) and not _refused(each)]
        if found:
            what = invisible(line[found[0]])
            yield Located(file, number, found[0] + 1, f"invisible character {what}; delete it")


def _refused(character: str) -> bool:
    """True for one that the parser refuses. U+0085 is the end of a line to it, even in a comment."""
    return character < "\xa0" and character != "\x85"


class _Reader:
    """Turns events into data and collects findings."""

    def __init__(self, document: Document) -> None:
        self.document = document
        self.findings: list[Located] = []
        self.anchors: dict[str, KeyPath] = {}
        self.anchored: dict[str, Data] = {}
        self.values = 0

    def read(self, events: Iterator[yaml.Event]) -> None:
        documents = 0
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
            elif not isinstance(event, (yaml.StreamStartEvent, yaml.StreamEndEvent, yaml.DocumentEndEvent)):
                if documents > 1:
                    self._refuse(event, "a second document begins here; a robot file is one document")
                    return
                self.document.data = self._value(event, events, ())

    def _located(self, event: yaml.Event, message: str) -> Located:
        return Located(self.document.file, *_place(event), message)

    def _refuse(self, event: yaml.Event, message: str) -> None:
        self.findings.append(self._located(event, message))

    def _check_visible(self, event: yaml.ScalarEvent, path: KeyPath) -> None:
        """Refuse invisible characters that are written as escapes."""
        if not event.value.isprintable() and (what := invisible(event.value)):
            key = f"{path[-1]}: " if path and str(path[-1]).isprintable() else ""
            self._refuse(event, f"{key}invisible character {what}; delete it")

    def _value(self, event: yaml.Event, events: Iterator[yaml.Event], path: KeyPath) -> Data:
        self.document.values.setdefault(path, _place(event))
        self._count(event)
        if isinstance(event, yaml.AliasEvent):
            return self._repeat(event, path)
        value = self._new_value(event, events, path)
        anchor = getattr(event, "anchor", None)
        if anchor in self.anchors:
            self._refuse(event, f"anchor &{anchor} is used twice; an anchor names one value")
        elif anchor:
            # After the value, which cannot contain itself.
            self.anchors[anchor] = path
            self.anchored[anchor] = value
        return value

    def _count(self, event: yaml.Event) -> None:
        self.values += 1
        if self.values > MAX_VALUES:
            raise BadInputError([self._located(event, f"more than {MAX_VALUES} values, aliases written out")])

    def _repeat(self, event: yaml.AliasEvent, path: KeyPath) -> Data:
        """The value of an alias, with the positions of the original."""
        if event.anchor not in self.anchors:
            self._refuse(event, f"alias *{event.anchor} repeats nothing: no value above has &{event.anchor}")
            return None
        origin = self.anchors[event.anchor]

        def copied(value: Data, below: KeyPath) -> Data:
            self._count(event)
            for table in (self.document.keys, self.document.values):
                if below and origin + below in table:
                    table[path + below] = table[origin + below]
            if isinstance(value, dict):
                return {key: copied(each, (*below, key)) for key, each in value.items()}
            if isinstance(value, list):
                return [copied(each, (*below, index)) for index, each in enumerate(value)]
            return value

        return copied(self.anchored[event.anchor], ())

    def _new_value(self, event: yaml.Event, events: Iterator[yaml.Event], path: KeyPath) -> Data:
        tag = getattr(event, "tag", None)
        if tag:
            self._refuse(event, f"tags ({tag}) are not allowed")
        if isinstance(event, yaml.ScalarEvent):
            self._check_visible(event, path)
            return _scalar(event)
        if len(path) >= MAX_DEPTH:
            raise BadInputError([self._located(event, f"nested deeper than {MAX_DEPTH} levels")])
        if isinstance(event, yaml.SequenceStartEvent):
            items: list[Data] = []
            while not isinstance(event := next(events), yaml.SequenceEndEvent):
                items.append(self._value(event, events, (*path, len(items))))
            return items
        return self._mapping(events, path)

    def _mapping(self, events: Iterator[yaml.Event], path: KeyPath) -> dict[str, Data]:
        mapping: dict[str, Data] = {}
        while not isinstance(event := next(events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                self._refuse(event, "a key must be a plain scalar")
                self._value(event, events, (*path, "?"))
                self._value(next(events), events, (*path, "?"))
                continue
            self._check_visible(event, ())
            if event.value == "<<":
                self._refuse(event, "merge keys (<<) are not allowed; write the keys out")
            here = (*path, event.value)
            if event.value in mapping:
                line = self.document.keys[here][0]
                self._refuse(event, f"key {event.value!r} is already on line {line}; a key is written once")
                self._value(next(events), events, (*path, "?"))
                continue
            self.document.keys[here] = _place(event)
            mapping[event.value] = self._value(next(events), events, here)
        return mapping


def step_into(data: Data, step: str | int) -> tuple[Data] | tuple[()]:
    """The data one step below, as a tuple of one; empty when there is none."""
    if isinstance(data, dict) and isinstance(step, str) and step in data:
        return (data[step],)
    if isinstance(data, list) and isinstance(step, int) and step < len(data):
        return (data[step],)
    return ()


def _place(event: yaml.Event) -> tuple[int, int]:
    """Line and column of an event, from 1."""
    mark = event.start_mark
    return (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)


def _scalar(event: yaml.ScalarEvent) -> Data:
    """Value of a scalar by the YAML 1.2 core schema; quoted scalars are always text."""
    text = event.value
    if event.style is not None:
        return str(text)
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INTEGER.fullmatch(text) and len(text) < 40:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return str(text)
