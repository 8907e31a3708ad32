"""RELEASING.md: its versions are those of the code, and public names since 0.1.0 have their version."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import contid
import contid.hal
from contid.remote.client.procedures import Procedures
from contid.remote.protocol.wire import PROTOCOL
from contid.session.format.channels import REVISION
from contid_drivers.due.codes import PROTOCOL_VERSION

pytestmark = pytest.mark.process

ROOT = Path(__file__).parents[2]
RELEASED = Path(__file__).with_name("public-names-0.1.0.txt")
VERSION = re.compile(r"\d+\.\d+\.\d+(?:\.dev0)?")
ADDED = re.compile(r"^\.\. versionadded:: (\d+\.\d+\.\d+)$", re.MULTILINE)


def read(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def number(path: str, pattern: str) -> str:
    """What the only match of a pattern in a file has in its group."""
    (found,) = re.findall(pattern, read(path), re.MULTILINE)
    return str(found)


def test_the_table_has_the_four_versions_of_the_code() -> None:
    rows = re.findall(
        r"^\| ([a-z ]+) \| ([\d.dev]+) \| `(\w+)` of `([^`]+)`", read("RELEASING.md"), re.MULTILINE
    )
    assert [(name, now) for name, now, *_ in rows] == [
        ("package", contid.__version__),
        ("socket protocol", str(PROTOCOL)),
        ("session revision", str(REVISION)),
        ("firmware protocol", str(PROTOCOL_VERSION)),
    ]
    for _, now, name, path in rows:
        declared = number(path, rf"^(?:const uint8_t )?{name}(?:: Final)? = \"?([\w.]+)\"?;?$")
        assert declared == now, path


@pytest.mark.parametrize(
    ("path", "pattern", "version"),
    [
        ("docs/remote.md", r'"event":"hello","protocol":(\d+)', PROTOCOL),
        ("docs/sessions.md", r"^This is revision (\d+) of the messages", REVISION),
        ("firmware/PROTOCOL.md", r"^# Protocol of the Due boards, version (\d+)$", PROTOCOL_VERSION),
        ("firmware/PROTOCOL.md", r"^Payload: `version u8 \((\d+)\)`", PROTOCOL_VERSION),
        ("firmware/contid_due/src/core/protocol.h", r"PROTOCOL_VERSION = (\d+);", PROTOCOL_VERSION),
    ],
)
def test_pages_have_the_versions_of_the_code(path: str, pattern: str, version: int) -> None:
    assert number(path, pattern) == str(version)


def test_the_newest_section_of_the_changelog_and_the_citation_are_of_this_version() -> None:
    assert VERSION.fullmatch(contid.__version__)
    heading, *older = re.findall(r"^## \[(.+)$", read("CHANGELOG.md"), re.MULTILINE)
    if contid.__version__.endswith(".dev0"):
        assert heading == "Unreleased]"
        heading = older[0]
    else:
        assert heading.startswith(f"{contid.__version__}] - ")
    cited = number("CITATION.cff", r"^version: (\S+)$"), number("CITATION.cff", r"^date-released: (\S+)$")
    assert heading == "{}] - {}".format(*cited)


def test_the_version_of_the_package_is_declared_once(tmp_path: Path) -> None:
    """The build takes it from the code: the metadata that pip would read."""
    script = (
        "from scikit_build_core.build import prepare_metadata_for_build_wheel as prepare\n"
        "import sys\n"
        "prepare(sys.argv[1])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    (metadata,) = tmp_path.glob("*/METADATA")
    assert f"\nVersion: {contid.__version__}\n" in metadata.read_text(encoding="utf-8")
    declared = [path for path in ("pyproject.toml", "CMakeLists.txt") if contid.__version__ in read(path)]
    assert not declared


def public() -> Iterator[tuple[str, str]]:
    """Name and docstring of what the API page shows: classes, functions, methods and properties."""
    documented: dict[str, Any] = {f"contid.{name}": getattr(contid, name) for name in contid.__all__}
    documented |= {"contid.client.Procedures": Procedures}
    documented |= {f"contid.hal.{name}": getattr(contid.hal, name) for name in contid.hal.__all__}
    for name, each in documented.items():
        if not inspect.isclass(each) and not inspect.isroutine(each):
            continue
        yield name, inspect.getdoc(each) or ""
        for member, value in inspect.getmembers(each) if inspect.isclass(each) else ():
            ours = getattr(value, "fget", value)
            if member[0] != "_" and (getattr(ours, "__module__", "") or "").startswith("contid"):
                yield f"{name}.{member}", inspect.getdoc(value) or ""


def unmarked(names: Iterator[tuple[str, str]]) -> set[str]:
    return {name for name, text in names if not ADDED.search(text)}


def test_public_names_without_versionadded_are_those_of_the_first_release() -> None:
    released = RELEASED.read_text(encoding="utf-8").split()
    assert len(released) > 100
    assert released == sorted(released)
    found = unmarked(public())
    assert sorted(found - {*released}) == [], "these need `.. versionadded:: VERSION` in their docstrings"
    assert sorted({*released} - found) == [], "these are gone: a line under *Changed* in CHANGELOG, and here"


def test_versions_in_docstrings_are_later_than_the_first_and_not_of_the_future() -> None:
    now = tuple(int(part) for part in contid.__version__.removesuffix(".dev0").split("."))
    found = {name: ADDED.findall(text) for name, text in public() if ADDED.search(text)}
    for name, versions in found.items():
        for version in versions:
            assert (0, 1, 0) < tuple(int(part) for part in version.split(".")) <= now, name


@pytest.mark.parametrize(
    ("text", "found"),
    [("Does it.", {"new"}), ("Does it.\n\n.. versionadded:: 0.2.0", set()), ("versionadded", {"new"})],
)
def test_a_new_name_without_its_version_is_found(text: str, found: set[str]) -> None:
    assert unmarked(iter([("new", text)])) == found
