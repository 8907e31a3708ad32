"""Drivers that know their devices again, whatever name their port has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from contid.hal.bus import AxisOnBus
from contid.hal.optional import Report

if TYPE_CHECKING:
    from pydantic import BaseModel


@runtime_checkable
class Identifies(Protocol):
    """Refuses other devices than those a bus had before: ``contid doctor --accept``."""

    def accept(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus], report: Report) -> None:
        """Take the devices that answer as those of the bus from now on; moves nothing.

        Raises:
            DeviceError: one does not answer, or cannot be marked.
        """
