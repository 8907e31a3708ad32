"""The whole robot file: buses and robots as validated values; see `loader` for positions."""

from __future__ import annotations

import enum
import glob
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from contid.errors import Located
from contid.robot_file.base import Strict
from contid.robot_file.chain import Chain
from contid.robot_file.clearance import Clearance
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.positions import Document
from contid.robot_file.proven.bringup import AxisBringup
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.tendon.robot import TendonRobot
from contid.robot_file.tri_rack import TriRack
from contid.robot_file.tri_tube import TriTube

#: One class per model; a robot file's ``model`` key decides which.
AnyRobot: TypeAlias = Annotated[
    RackFinger | TriRack | TriTube | Cosserat | TendonRobot | Chain, Field(discriminator="model")
]

#: A shorter tick leaves no time for a serial bus.
MAX_RATE_HZ: Final = 1000.0


class Isolation(enum.StrEnum):
    """Where the driver of a bus runs."""

    PROCESS = "process"
    THREAD = "thread"


class BusDescription(BaseModel):
    """One bus: its driver, its tolerance of missed exchanges, and the keys of the driver.

    Attributes:
        driver: name of the driver.
        tolerance_ticks: exchanges in a row an axis may miss before its robot goes to FAULT.
        isolation: ``process``: the driver runs in a process of its own, where nothing that it does costs
            another bus; ``thread``: in the control process. By default ``thread`` for the drivers of contid,
            ``process`` for those of others.
    """

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    driver: str
    tolerance_ticks: int = Field(default=3, ge=1, le=1000)
    isolation: Isolation | None = None


@dataclass(frozen=True, slots=True)
class BusWiring:
    """One bus ready to be built: its driver, the driver's options, its axes in file order.

    Attributes:
        axes: ``("ROBOT.AXIS", the driver's options of that axis)``.
        tolerance_ticks: exchanges in a row an axis may miss before its robot goes to FAULT.
        isolation: where its driver runs.
    """

    name: str
    driver: str
    options: BaseModel
    axes: tuple[tuple[str, BaseModel], ...]
    tolerance_ticks: int
    isolation: Isolation = Isolation.THREAD


class RobotFile(Strict):
    """A robot file after validation.

    Attributes:
        contid: version of this format.
        name: name of the whole file, one line; goes into recordings.
        rate_hz: ticks per second of the control loop.
        buses: what axes are wired to, by names of your choice.
        robots: robots by names of your choice.
        clearance: distances that trajectories must keep; not checked when left out.
        bringup: what was proven about each axis, by ``ROBOT.AXIS``; `contid bringup` writes it.
    """

    contid: Literal[1]
    name: Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,100}$")]
    rate_hz: Annotated[float, Field(gt=0, le=MAX_RATE_HZ)]
    buses: dict[str, BusDescription]
    robots: dict[str, AnyRobot]
    clearance: Clearance | None = None
    bringup: dict[str, AxisBringup] = Field(default={})


def check_ports(document: Document, buses: Iterable[BusWiring]) -> Iterator[Located]:
    """Refuse a bus whose port is the device of an earlier one, by the same or another name."""
    owners: dict[str, BusWiring] = {}
    for bus in buses:
        port = getattr(bus.options, "port", None)
        if not isinstance(port, str):
            continue
        owner = owners.setdefault(_device(port), bus)
        if owner is not bus:
            message = f"port: {port} is the device of bus {owner.name} as well; a device is one bus"
            yield document.at_value(("buses", bus.name, "port"), message)


def _device(port: str) -> str:
    """The device behind a path or a glob, links followed; the path itself while it does not exist."""
    path = str(Path(port).expanduser())
    found = glob.glob(path)  # noqa: PTH207  # an absolute pattern has no Path to start from
    return os.path.realpath(found[0] if len(found) == 1 else path)
