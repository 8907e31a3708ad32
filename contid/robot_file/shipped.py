"""The robot files that ship with contid, found by name: ``hand`` is ``configs/hand.yaml``.

They are in ``contid/configs`` when installed (see CMakeLists.txt), in ``configs`` at the top of a checkout.
"""

from __future__ import annotations

from pathlib import Path

from contid.errors import ContidError
from contid.robot_file.findings import allowed_names
from contid.robot_file.load import LoadedFile, load_robot_file


def configs_folder() -> Path:
    """Folder of the shipped robot files."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def load_named(name: str) -> LoadedFile:
    """Read and check a robot file, or the shipped one of that name.

    Raises:
        ContidError: as `find_robot_file` and `load_robot_file`.
    """
    return load_robot_file(find_robot_file(name))


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
    raise ContidError(f"{name}: no such file and no shipped robot file; {allowed_names(shipped, name)}")
