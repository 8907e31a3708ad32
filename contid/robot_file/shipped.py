"""The robot files that ship with contid, found by name: ``hand`` is ``configs/hand.yaml``.

An installed contid carries them inside its own package (``contid/configs``, see CMakeLists.txt); in a
checkout they are the folder ``configs`` at the top.
"""

from __future__ import annotations

import difflib
from pathlib import Path

from contid.errors import ContidError


def configs_folder() -> Path:
    """Folder of the shipped robot files."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def find_robot_file(name: str) -> Path:
    """``name`` itself if it is a file, else the shipped robot file of that name.

    Raises:
        ContidError: neither; the message lists the shipped names and the nearest one.
    """
    path = Path(name)
    if path.is_dir():
        raise ContidError(f"{name}: is a folder; name a robot file in it")
    if path.exists():  # a pipe as well: contid check <(sed ... hand.yaml)
        return path
    shipped = {file.stem: file for file in sorted(configs_folder().glob("*.yaml"))}
    if name in shipped:
        return shipped[name]
    near = difflib.get_close_matches(name, shipped, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ContidError(f"{name}: no such robot file; shipped ones are {', '.join(shipped) or 'none'}{hint}")
