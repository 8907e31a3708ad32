"""The whole robot file: buses and robots, as validated values (loading with positions is in `load`)."""

from __future__ import annotations

from typing import Annotated, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from contid.robot_file.base import Strict
from contid.robot_file.chain import Chain
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.rack_finger import RackFinger
from contid.robot_file.tri_rack import TriRack
from contid.robot_file.tri_tube import TriTube

#: One class per model; a robot file's ``model`` key decides which.
AnyRobot: TypeAlias = Annotated[
    RackFinger | TriRack | TriTube | Cosserat | Chain, Field(discriminator="model")
]

#: Beyond a thousand ticks per second a tick has no time left for a serial bus.
MAX_RATE_HZ: Final = 1000.0


class BusDescription(BaseModel):
    """One bus: its driver, how patient to be, and the driver's own keys.

    Attributes:
        driver: who speaks to the devices.
        tolerance_ticks: exchanges in a row an axis may miss before its robot goes to FAULT.
    """

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    driver: str
    tolerance_ticks: int = Field(default=3, ge=1, le=1000)


class RobotFile(Strict):
    """A robot file after validation.

    Attributes:
        contid: version of this format.
        name: of the whole file, one line; goes into recordings.
        rate_hz: ticks per second of the control loop.
        buses: what axes are wired to, by a name of your choice.
        robots: what moves, by a name of your choice.
    """

    contid: Literal[1]
    name: Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,100}$")]
    rate_hz: Annotated[float, Field(gt=0, le=MAX_RATE_HZ)]
    buses: dict[str, BusDescription]
    robots: dict[str, AnyRobot]
