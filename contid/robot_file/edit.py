"""Writing single values into a robot file atomically; comments, order, anchors, quotes and line ends stay.

ruamel.yaml reads and writes the text. A value that others share through an alias or a merge key is written
for the given key only: what it shares becomes a copy, and the result is compared with what was asked for.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, TypeAlias

from contid.errors import ContidError
from contid.robot_file.positions import decoded, read_raw
from contid.whole_file import replacing

Value: TypeAlias = float | int | str | bool | list[float] | list[str] | Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Change:
    """One value to write: a dotted key, its new value, and its origin (written as a comment).

    Parts of lists are numbered from 0: ``robots.arm.geometry.sections.0.modulus_pa``.
    """

    key: str
    value: Value
    comment: str = ""


def set_values(
    path: Path, changes: Sequence[Change], check: Callable[[str], object] = lambda text: None
) -> None:
    """Write values into a YAML file, all of them or none.

    A missing last part of a key is added; its mapping must exist.

    Args:
        path: path of the file.
        changes: what to write.
        check: is called with the new text before it replaces the old one; what it raises leaves that.

    Raises:
        ContidError: a key's mapping is not in the file, or the file cannot be read or written.
    """
    raw = read_raw(path)
    ends = "\r\n" if b"\r\n" in raw else "\n"
    text = edited(decoded(raw, path), changes)
    check(text)
    with replacing(path) as file:
        file.write(text.replace("\n", ends).encode())


def edited(text: str, changes: Sequence[Change]) -> str:
    """The text with the changes made.

    Raises:
        ContidError: a key is not in the text, the text is not YAML, or it cannot be written without another
            change.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = 4096
    yaml.indent(mapping=2, sequence=4, offset=2)
    try:
        document: Any = yaml.load(text)
    except YAMLError as error:  # the file was changed since it was checked
        keys = ", ".join(change.key for change in changes)
        raise ContidError(f"{keys}: not written, the file is not YAML: {_in_short(error)}") from error
    expected = _plain(document)
    for change in changes:
        *parents, last = _path(document, change.key)
        _unshare(document, [*parents, last])
        node = document
        for i, parent in enumerate(parents):
            try:
                node = _below(node, parent)
            except (LookupError, ValueError, TypeError):
                there = ".".join(parents[: i + 1])
                raise ContidError(f"{change.key}: the file has no key {there}") from None
        if not isinstance(node, dict):
            raise ContidError(f"{change.key}: {'.'.join(parents)} is not a mapping")
        old = node.get(last)
        if isinstance(change.value, list) and isinstance(old, list):
            _replace(node, last, change.value)
        else:
            node[last] = _on_one_line(change.value)
        _set(expected, [*parents, last], change.value)
        if change.comment:
            _comment(document, node, parents, last, change.comment)
    out = StringIO()
    yaml.dump(document, out)
    written = out.getvalue()
    if _plain(yaml.load(written)) != expected:
        keys = ", ".join(change.key for change in changes)
        raise ContidError(f"{keys}: cannot be written alone; write its aliases (*) out in full")
    return written


def _in_short(error: Exception) -> str:
    """What is wrong, and where."""
    mark = getattr(error, "problem_mark", None)
    place = "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"
    return f"{getattr(error, 'problem', None) or error}{place}"


def _plain(node: Any) -> Any:
    """A copy in which nothing is shared; aliases and merge keys are written out."""
    if isinstance(node, Mapping):
        return {key: _plain(inner) for key, inner in node.items()}
    return [_plain(inner) for inner in node] if isinstance(node, list) else node


def _set(plain: Any, path: Sequence[str], value: Value) -> None:
    for part in path[:-1]:
        plain = _below(plain, part)
    plain[path[-1]] = _plain(value)


def _unshare(document: Any, path: Sequence[str]) -> None:
    """Replace what the way to a key shares with other keys by copies; a key that is missing is left alone."""
    node = document
    for part in path:
        try:
            inner = _below(node, part)
        except (LookupError, ValueError, TypeError):
            return
        if isinstance(inner, dict | list) and _places(document)[id(inner)] > 1:
            inner = _apart(inner)
            node[int(part) if isinstance(node, list) else part] = inner
        node = inner


def _apart(node: Any) -> Any:
    """A copy that shares nothing, with its comments and without anchors."""
    from ruamel.yaml.anchor import Anchor

    made = copy.deepcopy(node)
    if hasattr(made, Anchor.attrib):
        delattr(made, Anchor.attrib)
    for key, inner in list(node.items() if isinstance(node, dict) else enumerate(node)):
        inherited = any(merged.get(key) is inner for merged in getattr(node, "merge", ()))
        if isinstance(inner, dict | list) and not inherited:
            made[key] = _apart(inner)
    return made


def _places(document: Any) -> Counter[int]:
    """How many mappings and lists hold a mapping or a list, by its identity; merge keys count as well."""
    places: Counter[int] = Counter()
    waiting, seen = [document], {id(document)}
    while waiting:
        node = waiting.pop()
        inners = list(node.values()) if isinstance(node, dict) else list(node)
        inners += getattr(node, "merge", ())
        for inner in inners:
            if not isinstance(inner, dict | list):
                continue
            places[id(inner)] += 1
            if id(inner) not in seen:
                seen.add(id(inner))
                waiting.append(inner)
    return places


def _on_one_line(value: Any) -> Any:
    """The value with lists of numbers inside a mapping in flow style: they are long."""
    from ruamel.yaml.comments import CommentedSeq

    def written(each: Any) -> Any:
        if isinstance(each, Mapping):
            return {key: written(inner) for key, inner in each.items()}
        if not isinstance(each, list):
            return each
        listed = CommentedSeq(map(written, each))
        if not any(isinstance(inner, list) for inner in each):
            listed.fa.set_flow_style()
        return listed

    return written(value) if isinstance(value, Mapping) else value


def _replace(node: Any, key: str, new: list[Any]) -> None:
    """Give a list other elements; it stays on its line, if it was written on one.

    The comments of elements that stay stay. What follows the last element is kept in the same token.
    """
    from ruamel.yaml.error import CommentMark
    from ruamel.yaml.tokens import CommentToken

    listed = node[key]
    before = [(value, listed.ca.items.get(i)) for i, value in enumerate(listed)]
    ending = before[-1][1] if before else None
    _, _, following = ending[0].value.partition("\n") if ending and ending[0] else ("", "", "")
    if ending and following and (not new or new[-1] != before[-1][0]):
        ending[0].value = ending[0].value.partition("\n")[0] + "\n"
        token = CommentToken("\n" + following, CommentMark(0), None)
    else:
        token = None
    listed[:] = new
    listed.ca.items.clear()
    for i, value in enumerate(new):
        kept = next((tokens for old, tokens in before if old == value and tokens), None)
        if kept is not None:
            listed.ca.items[i] = kept
    if token is None:
        return
    if not new:
        listed.fa.set_flow_style()
    items, at, place = (listed.ca.items, len(new) - 1, 0) if new else (node.ca.items, key, 2)
    found = items.setdefault(at, [None] * (2 if new else 4))
    if found[place] is None:
        found[place] = token
    else:
        found[place].value = found[place].value.partition("\n")[0] + token.value


def _path(document: Any, key: str) -> list[str]:
    """The parts of a dotted key; axis names contain dots, so the longest existing name wins."""
    rest = key.split(".")
    path: list[str] = []
    node = document
    while len(rest) > 1:
        names = [".".join(rest[:count]) for count in range(len(rest) - 1, 0, -1)]
        name = next((name for name in names if isinstance(node, dict) and name in node), rest[0])
        try:
            node = _below(node, name)
        except (LookupError, ValueError, TypeError):
            break
        path.append(name)
        rest = rest[name.count(".") + 1 :]
    return [*path, *rest]


def _below(node: Any, part: str) -> Any:
    """Step down a dotted key: by a name in a mapping, by a number in a list."""
    return node[int(part)] if isinstance(node, list) else node[part]


def _comment(document: Any, node: Any, parents: list[str], last: str, comment: str) -> None:
    """Write the comment behind the value, or behind the outermost mapping or list in flow style around it."""
    while node.fa.flow_style() and parents:
        *parents, last = parents
        node = document
        for parent in parents:
            node = _below(node, parent)
    if node.fa.flow_style():
        return  # the whole document is in flow style: a comment would hide the rest of its line
    key = int(last) if isinstance(node, list) else last
    # The comment of a list's element is the first of its tokens, of a mapping's value the third.
    place = 0 if isinstance(node, list) else 2
    items = node.ca.items.get(key)
    if items is not None and items[place] is not None and items[place].value.lstrip().startswith("#"):
        # The same token holds the blank lines and the comment that follow; keep them.
        _, _, rest = items[place].value.partition("\n")
        items[place].value = f"# {comment}\n{rest}"
    else:
        node.yaml_add_eol_comment(comment, key, column=0)
