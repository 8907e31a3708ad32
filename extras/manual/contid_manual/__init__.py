"""Pages made from the code: faults, states, and the keys of the robot file with their JSON Schema."""

from __future__ import annotations

from typing import Final

#: Commands of this extra, see `contid.cli.support.table`.
COMMANDS: Final = {
    "fault": ("contid_manual.fault", "cause and remedy of a fault"),
    "schema": ("contid_manual.schema_command", "print the JSON Schema of the robot file"),
}
