"""Loading a robot file, also a shipped one by its name: validated, or every mistake with its place.

The files that ship with contid are in ``contid/configs`` when installed (see CMakeLists.txt), in ``configs``
at the top of a checkout: ``hand`` is ``configs/hand.yaml``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from contid.errors import BadInputError, ContidError, first_findings
from contid.hal import load_driver
from contid.robot_file.document import BusWiring, Isolation, RobotFile
from contid.robot_file.findings import allowed_names, with_renamed_keys
from contid.robot_file.loader import Loader, robot_classes
from contid.robot_file.model_plugins import load_plugin
from contid.robot_file.positions import read_document, read_text
from contid.robot_file.proven.bringup import slowed
from contid.robot_file.robot import RobotDescription


@dataclass(frozen=True, slots=True)
class LoadedFile:
    """A robot file that passed every check.

    Attributes:
        path: where it was read.
        text: what was read, for recordings.
        file: the validated values.
        buses: wiring of each bus, by name.
        known_sha256: that of the values before models of others were packed, "" before that.
    """

    path: Path
    text: str
    file: RobotFile
    buses: Mapping[str, BusWiring]
    known_sha256: str = ""

    @property
    def sha256(self) -> str:
        """Of the values that were written, without rates and bring-up, which change no robot's shape."""
        if self.known_sha256:
            return self.known_sha256
        left_out: Any = {"bringup": True, "robots": {"__all__": {"rates"}}}
        values = self.file.model_dump_json(exclude=left_out, exclude_unset=True, serialize_as_any=True)
        return hashlib.sha256(values.encode()).hexdigest()

    @property
    def driven(self) -> Mapping[str, RobotDescription]:
        """Robots with actuators; passive ones have no place in the tick."""
        return {name: robot for name, robot in self.file.robots.items() if not robot.passive}


def load_robot_file(path: str | Path) -> LoadedFile:
    """Read and check a robot file.

    Raises:
        BadInputError: with every finding, ``file:line:column: what; allowed; nearest name``.
        ContidError: the file cannot be read.
    """
    path = Path(path)
    return parse_robot_file(read_text(path), str(path))


def parse_robot_file(text: str, name: str, recorded: bool = False) -> LoadedFile:
    """Check the text of a robot file.

    Args:
        text: the YAML text.
        name: name of the file in messages.
        recorded: the text comes from a session file; keys of older revisions are accepted, and
            ``rate_hz`` is not checked against the drivers.

    Raises:
        BadInputError: as `load_robot_file`.
    """
    document = read_document(text, name)
    if recorded:
        document.data = with_renamed_keys(document.data)
    loader = Loader(document, recorded)
    buses = loader.load()
    if loader.findings:
        raise BadInputError(first_findings(loader.findings))
    return slowed(LoadedFile(Path(name), text, _robot_file(document.data), buses))


def with_mock(loaded: LoadedFile) -> LoadedFile:
    """The same robots on simulated buses, for ``--mock``; drivers give the options of their substitutes."""
    sim = load_driver("sim")
    buses: dict[str, BusWiring] = {}
    for name, bus in loaded.buses.items():
        if bus.driver == "sim":
            buses[name] = bus
            continue
        driver = load_driver(bus.driver)
        axes = tuple(
            (axis, sim.axis_options(**driver.mock_axis_options(options))) for axis, options in bus.axes
        )
        options = sim.bus_options(**driver.mock_options(bus.options))
        buses[name] = replace(bus, driver="sim", options=options, axes=axes, isolation=Isolation.THREAD)
    # Simulated devices are not those that were proven.
    return replace(loaded, buses=buses, file=loaded.file.model_copy(update={"bringup": {}}))


def _robot_file(data: Any) -> RobotFile:
    """A checked document as values; robots of models from other distributions join the union here."""
    kinds = robot_classes()
    robots = data["robots"]
    own = {name: raw for name, raw in robots.items() if raw["model"] in kinds}
    file = RobotFile.model_validate_json(json.dumps({**data, "robots": own}), strict=True)
    if len(own) == len(robots):
        return file
    described = {
        name: file.robots[name]
        if name in own
        else load_plugin(raw["model"]).description.model_validate_json(json.dumps(raw), strict=True)
        for name, raw in robots.items()
    }
    return file.model_copy(update={"robots": described})


def configs_folder() -> Path:
    """Folder of the shipped robot files."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"


def _is_file(path: Path) -> bool:
    """False for a name that is too long to be one."""
    try:
        return path.is_file()
    except OSError:
        return False


def load_named(name: str) -> LoadedFile:
    """Read and check a robot file, or the shipped one of that name.

    Raises:
        ContidError: as `find_robot_file` and `load_robot_file`.
    """
    return load_robot_file(find_robot_file(name))


def find_robot_file(name: str) -> Path:
    """``name`` itself if it is a file, else ``name.yaml`` or ``.yml`` beside it, else the shipped robot file.

    Raises:
        ContidError: neither; the message lists the shipped names and the nearest one.
    """
    path = Path(name)
    try:
        folder, exists = path.is_dir(), path.exists()
    except OSError as error:  # no permission for a folder on the way, or a name that is too long
        raise ContidError(f"{name}: cannot read it: {error.strerror}") from error
    if folder:
        raise ContidError(f"{name}: is a folder; name a robot file in it")
    if exists:  # a pipe as well: contid check <(sed ... hand.yaml)
        return path
    beside = [file for suffix in (".yaml", ".yml") if _is_file(file := Path(name + suffix))]
    shipped = {file.stem: file for file in sorted(configs_folder().glob("*.yaml"))}
    if len(beside) + (name in shipped) > 1:
        places = ", ".join(str(file) for file in [*beside, *([shipped[name]] if name in shipped else [])])
        raise ContidError(f"{name}: could be one of {places}; write the whole path of the one you mean")
    if beside:
        return beside[0]
    if name in shipped:
        return shipped[name]
    emulated = "." in name.removesuffix(".yaml").removesuffix(
        ".yml"
    )  # each is shipped a second time as NAME.emulated
    listed = [each for each in shipped if emulated or "." not in each]
    raise ContidError(f"{name}: no such file and no shipped robot file; {allowed_names(listed, name)}")
