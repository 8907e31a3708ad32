"""Recordings that have ended during the run: pages list them, and play what was commanded in them again."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Final

from contid.errors import ContidError
from contid.remote.client.described_robot import columns_of
from contid.remote.protocol.wire import Fields
from contid.session.read import Session
from contid_sessions.listing import listed

#: Recordings that a page lists; older ones are dropped from the list, not from the disk.
MAX_LISTED: Final = 20
#: Rows per second of a recording that is played again.
ROWS_PER_S: Final = 20.0


class Recorded:
    """The ended recordings of a run, by the states that its daemon reports.

    A recording counts as ended when a state does not list it any more that the one before did.
    """

    def __init__(self) -> None:
        #: Paths of the recordings under way at the last state.
        self._open: set[str] = set()
        #: By file name, the newest last; all recordings of a run are in one folder.
        self._ended: dict[str, Fields] = {}

    async def after(self, status: Fields) -> list[Fields]:
        """The ended recordings after a status, the newest first: name, file, seconds.

        Args:
            status: answer of the daemon to ``status``; the recording of the whole run does not count.
        """
        now = {each["file"] for each in status["recordings"] if not each["whole_run"]}
        for file in sorted(self._open - now):
            found = await asyncio.to_thread(_facts, Path(file))
            if found is not None:
                self._ended[found["name"]] = found
        self._open = now
        for name in list(self._ended)[:-MAX_LISTED]:
            del self._ended[name]
        return list(reversed(self._ended.values()))

    async def trajectory(self, name: str, describe: Fields) -> str:
        """The commands of a listed recording as the text of a timed trajectory of all axes.

        Args:
            name: name of its file.
            describe: answer of the daemon to ``describe``.

        Raises:
            ContidError: it is not listed, was made with other robots, or has no command.
        """
        if name not in self._ended:
            raise ContidError(f"{name[:80]}: not a recording of this run")
        return await asyncio.to_thread(_commanded, Path(self._ended[name]["file"]), describe)


def _facts(path: Path) -> Fields | None:
    """What a page lists of a recording; ``seconds`` is None where it has no end."""
    try:
        found = listed(path)
    except OSError:  # it was moved away
        return None
    return {"name": path.name, "file": str(path), "seconds": found.duration_s}


def _commanded(path: Path, describe: Fields) -> str:
    """The trajectory of `Recorded.trajectory`, at most `ROWS_PER_S` rows a second, from 0 s.

    Ticks in which an axis of any robot was not commanded have no row; the curve leads over them.

    Raises:
        ContidError: it was made with other robots, or has fewer than two rows.
    """
    described = columns_of(describe)
    columns = [column for robot in described.values() for column in robot.axes]
    # Columns of a recording begin with the robot, also where those of a trajectory do not.
    single = next(iter(described)) if len(described) == 1 else ""
    names = [f"command.{single}.{column}" if single else f"command.{column}" for column in columns]
    lines, begun_s, next_s = [",".join(["t_s", *columns])], math.nan, -math.inf
    for row in Session(path):
        if missing := [name for name in names if name not in row]:
            raise ContidError(f"{path.name}: made with other robots: it has no {missing[0]}")
        values = [row[name] for name in names]
        if row["robot_s"] < next_s or not all(map(math.isfinite, values)):
            continue
        begun_s = row["robot_s"] if math.isnan(begun_s) else begun_s
        next_s = row["robot_s"] + 1.0 / ROWS_PER_S - 1e-6  # rounding leaves no tick out
        lines.append(",".join(f"{value:.9g}" for value in (row["robot_s"] - begun_s, *values)))
    if len(lines) < 3:
        raise ContidError(f"{path.name}: no robot was commanded in it")
    return "\n".join(lines) + "\n"
