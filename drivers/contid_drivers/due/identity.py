"""Which board is it, and does it stand where it counts from?

A board counts from ``power_up_deg`` after every start, by the rule that motors without homing are parked when
its power is off. The host remembers the id of its chip, its start and where the motors stood when the bus was
closed (`contid.kit.remembered`): after another start the rule is used for motors that stood there only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final

from contid.errors import DeviceNotFoundError
from contid.hal.pulses import ProvenDevice
from contid.kit.remembered import BusMemory, accept_remedy
from contid_drivers.due.axis import BoardAxis
from contid_drivers.due.messages import Hello
from contid_drivers.due.options import DueAxisOptions, DueBusOptions

#: A motor closer than this to its ``power_up_deg`` was parked: play and spring-back of a gear.
PARKED_RAD: Final = math.radians(10.0)
_BOARD: Final = "board"
#: Options that a change of cables or parts changes.
_WIRING: Final = (
    "channel", "bridge", "encoder_reversed", "motor_reversed", "counts_per_rev", "start_state", "on_watchdog",
    "current_ma_per_v", "calibration", "readback",
)  # fmt: skip


def require_known(name: str, path: str, hello: Hello, memory: BusMemory) -> None:
    """Refuse another board than the one before; before anything is sent to it.

    Raises:
        DeviceNotFoundError: another chip; names both.
    """
    remembered, found = memory.load(), hello.unique_id
    expected = None if remembered is None else remembered.devices.get(_BOARD)
    owner = memory.owner_of(found) if found != expected else ""
    if found == expected or (expected is None and not owner):
        return
    before = "one that no other bus has" if expected is None else expected
    raise DeviceNotFoundError(
        name,
        f"expected the board of before, {before}, at {path}, found board {found}"
        + (f", which belongs to {owner}" if owner else ""),
        accept_remedy(name),
    )


def unparked(hello: Hello, axes: Iterable[BoardAxis], memory: BusMemory) -> list[BoardAxis]:
    """Motors without homing that did not stand at their ``power_up_deg`` before the board started again.

    A bus that was not closed, or whose file is damaged, leaves all of them unknown.
    """
    remembered = memory.load()
    if remembered is None or remembered.boot == hello.boot_id:
        return []

    def away(axis: BoardAxis) -> bool:
        stood = remembered.positions_rad.get(axis.name)
        return stood is None or abs(stood - axis.power_up_rad) > PARKED_RAD

    return [axis for axis in axes if axis.motor and not axis.homes and away(axis)]


def stood_before(hello: Hello, memory: BusMemory) -> Mapping[str, float | None]:
    """Where the motors stood at the last close [rad], if the board has not started again since."""
    remembered = memory.load()
    return remembered.positions_rad if remembered is not None and remembered.boot == hello.boot_id else {}


def keep(hello: Hello, memory: BusMemory, positions_rad: Mapping[str, float | None]) -> None:
    """Remember a board, and where its motors stand; no positions while the bus is in use."""
    memory.save(
        replace(
            memory.empty,
            devices={_BOARD: hello.unique_id},
            boot=hello.boot_id,
            positions_rad=positions_rad,
        )
    )


def accept(hello: Hello, memory: BusMemory) -> str:
    """Take a board as that of the bus; where its motors stand is unknown. Returns a line about it."""
    memory.save(replace(memory.empty, devices={_BOARD: hello.unique_id}))
    return f"board {hello.unique_id}; motors without homing are parked by `contid home --parked`"


def board(hello: Hello) -> ProvenDevice:
    """The board behind a hello."""
    return ProvenDevice(hello.unique_id, ".".join(map(str, hello.firmware)))


def wiring(options: DueBusOptions, axis: DueAxisOptions) -> Mapping[str, object]:
    """The options of an axis and its bus that a change of wiring would change."""
    # Digests of axes without valves stay those of files that were written before there were any.
    keys = {*_WIRING} if axis.valves is None else {*_WIRING, "valves"}
    return {"role": options.role, "connection": options.connection} | axis.model_dump(
        mode="json", include=keys
    )
