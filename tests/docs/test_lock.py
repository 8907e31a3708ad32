"""requirements.lock: one version of every package that contid and its extras need, with hashes."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[2]
PINNED = re.compile(r"^([a-z0-9][a-z0-9._-]*)==([^ ;\\]+)(?: ; [^\\]+)? \\$", re.MULTILINE)


def _locked() -> dict[str, list[Version]]:
    found: dict[str, list[Version]] = {}
    for name, version in PINNED.findall((ROOT / "requirements.lock").read_text(encoding="utf-8")):
        found.setdefault(name, []).append(Version(version))
    return found


def test_the_lock_has_every_requirement_at_a_version_that_it_allows() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    # The extra "all" names the others in brackets.
    needed = [
        *project["dependencies"],
        *(each for name in Requirement(*extras["all"]).extras for each in extras[name]),
    ]
    locked = _locked()
    for requirement in map(Requirement, needed):
        if requirement.name == "contid":
            continue
        name = canonicalize_name(requirement.name)
        assert name in locked, f"{name}: refresh the lock as RELEASING.md has it"
        assert all(version in requirement.specifier for version in locked[name]), requirement


def test_every_version_has_hashes() -> None:
    entries = re.split(
        r"^(?=[a-z0-9])", (ROOT / "requirements.lock").read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    for entry in entries[1:]:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", entry), entry
