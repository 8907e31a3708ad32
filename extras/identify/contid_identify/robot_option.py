"""What the commands share: the options ``--robot`` and ``--map``, and what they choose."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from contid.robot_file.robot import RobotDescription
    from contid_identify.recording import RobotRecording

ROBOT: Final = click.option("--robot", "name", help="Which robot, where the file has several.")
MAP: Final = click.option(
    "--map",
    "map_file",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="What the columns mean of recordings that are tables (CSV and others), as for `contid adapt`.",
)


def chosen_robot(robot_file: str, names: Iterable[str], name: str | None) -> str:
    """The robot that is meant.

    Args:
        robot_file: as it was given, for messages.
        names: of the robots that have actuators.
        name: from ``--robot``; None where there is one.

    Raises:
        ContidError: no such robot, or several and no name.
    """
    from contid.errors import ContidError

    names = list(names)
    if name is None and len(names) == 1:
        return names[0]
    if name is None:
        raise ContidError(f"{robot_file}: {len(names)} robots ({', '.join(names)}); choose with --robot")
    if name not in names:
        raise ContidError(f"{robot_file}: no robot {name!r}; the file has {', '.join(names)}")
    return name


def azimuths_of(text: str | None) -> list[float | None]:
    """Azimuths [rad] of ``--azimuths-deg``: numbers and ``none``, with commas between them; empty for None.

    Raises:
        ContidError: something else stands between two commas.
    """
    from contid.errors import ContidError

    out: list[float | None] = []
    for place, each in enumerate([] if text is None else text.split(","), 1):
        if each.strip().lower() == "none":
            out.append(None)
            continue
        try:
            value = float(each)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise ContidError(
                f"--azimuths-deg: number {place} is {each.strip()!r}; allowed: degrees, or none"
            )
        out.append(math.radians(value))
    return out


def recorded(
    path: Path,
    name: str,
    robot: RobotDescription | None,
    map_file: Path | None,
    note: Callable[[str], None] = lambda text: click.echo(text, err=True),
) -> RobotRecording:
    """One robot of a session, or of the table of another program.

    Args:
        path: of either.
        name: of the robot.
        robot: its description, which a table does not have; None where none is known.
        map_file: mapping of a table.
        note: gets what was decided on the way.

    Raises:
        ContidError: see `read_recording` and `read_tabled`.
    """
    from contid.errors import ContidError
    from contid.session.format.mcap_records import MAGIC
    from contid_identify.recording import read_recording
    from contid_identify.recordings.tabled import read_tabled

    with path.open("rb") as file:
        is_session = file.read(len(MAGIC)) == MAGIC
    if is_session or path.suffix == ".mcap":
        if map_file is not None:
            raise ContidError(f"{path}: a session of contid states what its values mean; leave --map out")
        return read_recording(path, name)
    if robot is None:
        raise ContidError(f"{path}: a table does not have its robot; give its file with --for ROBOT_FILE")
    try:
        text = "" if map_file is None else map_file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ContidError(f"{map_file}: {error}") from None
    found = read_tabled(path, name, robot, text, "" if map_file is None else str(map_file))
    for each in found.notes:
        note(f"{path.name}: {each}")
    return found.recording
