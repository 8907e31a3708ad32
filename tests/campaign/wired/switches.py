"""The fault switches of emulated servos, adapters and boards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from tests.campaign.wired.lab_file import TOLERANCE_TICKS


@dataclass(frozen=True)
class Switch:
    """One fault switch.

    Attributes:
        name: of the emulator.
        on: axes it is for; empty for the whole bus.
        must: a robot that is watched goes to FAULT when it stays on.
        ticks: within this number of them, on top of those a bus takes to answer.
    """

    name: str
    on_axis: bool
    must: bool = False
    ticks: int = TOLERANCE_TICKS + 1


SERVO_SWITCHES: Final = (
    Switch("silent", True, True), Switch("overload", True, True, 2), Switch("alert", True, True, 2),
    Switch("brownout", True, True), Switch("trip", True, True, 2), Switch("unplug", False, True, 2),
    Switch("drop", True), Switch("corrupt", True), Switch("duplicate", True), Switch("delay", True),
    Switch("echo", False), Switch("late", False), Switch("latency", False), Switch("chunks", False),
    Switch("hiccup", False), Switch("host", False), Switch("jam", True), Switch("freeze", True),
)  # fmt: skip
#: Switches that count packets.
COUNTED: Final = ("drop", "corrupt", "duplicate")
#: Values of the adapter's switches, and those that switch them off.
ADAPTER: Final[dict[str, tuple[dict[str, float], ...]]] = {
    "late": ({"ms": 3.0}, {"ms": 12.0}), "latency": ({"ms": 1.0}, {"ms": 16.0}), "host": ({"hz": 20.0},),
    "chunks": ({"count": 7},), "hiccup": ({"ms": 4.0}, {"ms": 30.0}, {"ms": 120.0}),
}  # fmt: skip
BOARD_SWITCHES: Final = (
    Switch("silent", True, True), Switch("mute", False, True), Switch("reset", False, True),
    Switch("brown_out", False, True), Switch("freeze", False, True), Switch("unplug", False, True, 2),
    Switch("garbage", False),
)  # fmt: skip
MOTOR_SWITCHES: Final = (
    *BOARD_SWITCHES, Switch("bridge", True), Switch("stall", True), Switch("encoder_stuck", True),
    Switch("encoder_reversed", True),
)  # fmt: skip
REGULATOR_SWITCHES: Final = (*BOARD_SWITCHES, Switch("leak", True), Switch("wire", True))
