"""Deliberate bugs: the campaign on wires has to report each of them."""

from __future__ import annotations

from typing import Final

#: Deliberate bugs: code that disables a protection in every process of the daemon.
BUGS: Final[dict[str, str]] = {
    "estop skips the devices": (
        "from dataclasses import replace\n"
        "from contid.control.tick import transitions\n"
        "estop = transitions.estop\n"
        "transitions.estop = lambda *given: replace(estop(*given), pending=())\n"
    ),
    "estop waits for the end of the motion": (
        "from contid.control.tick import transitions\n"
        "transitions.estop = lambda plan, was, now_s: was if was.mode.name == 'OFF' else transitions.stop(\n"
        "    plan, was, transitions.StopPolicy.RELAX, now_s)\n"
    ),
}
