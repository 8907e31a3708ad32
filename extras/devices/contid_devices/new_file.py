"""A robot file of one's own as a copy of a shipped one: other name, ports and ids; every other byte stays.

Values are replaced at the places where the YAML parser found them, so comments, order and style stay.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import yaml

from contid.errors import BadInputError, ContidError, Located
from contid.robot_file.findings import allowed_names
from contid.robot_file.load import LoadedFile, configs_folder, load_robot_file
from contid.whole_file import new_file_mode

KeyPath: TypeAlias = tuple[str, ...]
#: Plain scalars of YAML: names, paths and numbers that need no quotes.
_PLAIN: Final = re.compile(r"[A-Za-z./][A-Za-z0-9_./:+-]*(?<!:)|[0-9]+")


@dataclass(frozen=True, slots=True)
class Template:
    """A shipped robot file and the places in it that a copy may change.

    Attributes:
        name: name of the shipped file.
        text: content of the file.
        ports: port of every bus that has one, by bus.
        ids: id of every axis that has one, by ``ROBOT.AXIS`` in file order.
    """

    name: str
    text: str
    ports: Mapping[str, str]
    ids: Mapping[str, int]


def shipped_templates() -> list[str]:
    """Names of the shipped files for hardware."""
    return sorted(file.stem for file in configs_folder().glob("*.yaml") if "." not in file.stem)


def read_template(name: str) -> Template:
    """The shipped robot file of a name.

    Raises:
        ContidError: there is none; the message lists the names.
    """
    names = shipped_templates()
    if name not in names:
        raise ContidError(f"--from {name}: no shipped robot file; {allowed_names(names, name)}")
    text = (configs_folder() / f"{name}.yaml").read_text(encoding="utf-8")
    found = _scalars_by_path(text)
    ports = {
        path[1]: each.value for path, each in found.items() if path[0] == "buses" and path[2:] == ("port",)
    }
    ids = {
        f"{path[1]}.{path[3]}": int(each.value)
        for path, each in found.items()
        if path[0] == "robots" and path[2:3] == ("axes",) and path[4:] == ("id",)
    }
    return Template(name, text, ports, ids)


def file_of(name: str) -> Path:
    """The file of a new robot: ``NAME.yaml``, or NAME itself when it has that ending.

    Raises:
        ContidError: it exists, its folder does not, or it is the name of a shipped file.
    """
    path = Path(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if not path.stem or not path.stem.isprintable():
        raise ContidError(f"{name!r} is no name of a file")
    if path.stem in {file.stem for file in configs_folder().glob("*.yaml")}:
        raise ContidError(f"{path.stem}: is the name of a shipped robot file; choose another")
    if path.exists() or path.is_symlink():
        raise ContidError(f"{path}: exists already; nothing was written")
    if not path.parent.is_dir():
        raise ContidError(f"{path}: there is no folder {path.parent}")
    return path


def write_copy(
    template: Template, path: Path, ports: Mapping[str, str], ids: Mapping[str, int]
) -> LoadedFile:
    """Write a copy with the name of its file, other ports and other ids; the copy passes `contid check`.

    Args:
        template: what is copied.
        path: path of the new file.
        ports: ports that change, by bus.
        ids: ids that change, by ``ROBOT.AXIS``.

    Raises:
        BadInputError: the copy would be invalid, as with one id twice; nothing was written.
        ContidError: the file exists or cannot be written.
    """
    values: dict[KeyPath, str] = {("name",): path.stem}
    values |= {("buses", bus, "port"): port for bus, port in ports.items()}
    for axis, number in ids.items():
        robot, _, name = axis.partition(".")
        values["robots", robot, "axes", name, "id"] = str(number)
    text = _replaced(template.text, values)
    try:
        handle, beside = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=".yaml", dir=path.parent)
    except OSError as error:
        raise ContidError(f"{path}: cannot be written: {error.strerror}") from error
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        try:
            load_robot_file(beside)
        except BadInputError as error:
            raise BadInputError(
                [Located(str(path), each.line, each.column, each.message) for each in error.findings]
            ) from error
        Path(beside).chmod(new_file_mode())
        # Fails when another program has made the file in the meantime; FAT and exFAT have no links for that.
        path.open("x").close()
        Path(beside).replace(path)
    except FileExistsError as error:
        raise ContidError(f"{path}: exists already; nothing was written") from error
    except OSError as error:
        raise ContidError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        Path(beside).unlink(missing_ok=True)
    return load_robot_file(path)


def _scalars_by_path(text: str) -> dict[KeyPath, yaml.ScalarNode]:
    """Every scalar in mappings of a document by its keys from the root."""
    root = yaml.compose(text)
    assert root is not None, "shipped files are not empty"
    return dict(_scalars(root, ()))


def _scalars(node: yaml.Node, path: KeyPath) -> Iterator[tuple[KeyPath, yaml.ScalarNode]]:
    """Every scalar in mappings, with its keys from the root."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            yield from _scalars(value, (*path, str(key.value)))
    elif isinstance(node, yaml.ScalarNode):
        yield path, node


def _replaced(text: str, values: Mapping[KeyPath, str]) -> str:
    """The text with scalars replaced."""
    found = _scalars_by_path(text)
    places = sorted(
        (
            (found[path].start_mark.index, found[path].end_mark.index, value, path[-1] == "id")
            for path, value in values.items()
        ),
        reverse=True,
    )
    for start, end, value, number in places:
        # A name such as 123 or null is a text.
        plain = _PLAIN.fullmatch(value) is not None and (number or yaml.safe_load(value) == value)
        text = text[:start] + (value if plain else json.dumps(value, ensure_ascii=False)) + text[end:]
    return text
