"""What a bring-up depends on, and what an encoder shows of a pulse; ``contid bringup`` has the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from contid.hal.bus import AxisOnBus

if TYPE_CHECKING:
    from pydantic import BaseModel


class ProvenDevice(NamedTuple):
    """The device that was examined: its unchangeable id, and its firmware."""

    identity: str
    firmware: str


class EncoderAnswer(NamedTuple):
    """What one encoder showed from the start of a pulse to the end of its trace.

    Attributes:
        counts: way, in the sense of the robot file.
        edges_a, edges_b: level changes of its tracks that the device saw.
        missed: edges it missed.
    """

    counts: int
    edges_a: int
    edges_b: int
    missed: int

    @property
    def edges(self) -> int:
        """Level changes of both tracks."""
        return self.edges_a + self.edges_b


@runtime_checkable
class Proves(Protocol):
    """Names what a bring-up depends on: cables and parts, and the devices that answer."""

    def wiring(self, options: BaseModel, axis: BaseModel) -> Mapping[str, object]:
        """The options of an axis and its bus that a change of wiring would change."""

    def devices(self, name: str, options: BaseModel, axes: Sequence[AxisOnBus]) -> Mapping[str, ProvenDevice]:
        """The device of each axis that answers now; moves nothing.

        Raises:
            DeviceError: the bus cannot be opened.
        """
