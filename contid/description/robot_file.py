"""The whole robot file: buses and robots, as validated values (loading with positions is in `load`)."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from contid.description.base import Positive, Strict
from contid.description.cosserat import Cosserat
from contid.description.rack_finger import RackFinger
from contid.description.tri_rack import TriRack
from contid.description.tri_tube import TriTube

#: One class per model; a robot file's ``model`` key decides which.
AnyRobot: TypeAlias = Annotated[RackFinger | TriRack | TriTube | Cosserat, Field(discriminator="model")]


class BusDescription(BaseModel):
    """One bus: its driver, how patient to be, and the driver's own keys.

    ``tolerance_ticks`` is how many exchanges in a row an axis may miss before its robot goes to FAULT.
    """

    model_config = ConfigDict(extra="allow", frozen=True, allow_inf_nan=False)

    driver: str
    tolerance_ticks: int = Field(default=3, ge=1, le=1000)


class RobotFile(Strict):
    """A robot file after validation."""

    contid: Literal[1]
    name: str
    rate_hz: Positive
    buses: dict[str, BusDescription]
    robots: dict[str, AnyRobot]
