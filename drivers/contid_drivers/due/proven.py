"""What a bring-up of a board's axes depends on: their cables and parts, and the board."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from contid.hal.pulses import ProvenDevice
from contid_drivers.due.messages import Hello
from contid_drivers.due.options import DueAxisOptions, DueBusOptions

#: Options that a change of cables or parts changes.
_WIRING: Final = (
    "channel", "bridge", "encoder_reversed", "motor_reversed", "counts_per_rev", "start_state", "on_watchdog",
    "current_ma_per_v", "calibration", "readback",
)  # fmt: skip


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
