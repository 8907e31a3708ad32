"""The line above the drawing: modes of the robots, and a fault with its remedy in large letters."""

from __future__ import annotations

from collections.abc import Sequence

from contid.control.engine.events import RunEvent
from contid.control.engine.events.robots import FaultLatched, ModeChanged
from contid.control.tick.faults import PAGES


class Banner:
    """Text that follows the events of a run."""

    def __init__(self, robots: Sequence[str]) -> None:
        self._modes = dict.fromkeys(robots, "OFF")
        self._faults: dict[str, FaultLatched] = {}

    def text(self) -> str:
        """Markdown: a heading per fault, else one line."""
        faults = [self._fault(robot, event) for robot, event in self._faults.items()]
        healthy = [f"{robot} **{mode}**" for robot, mode in self._modes.items() if robot not in self._faults]
        return "\n\n".join([*faults, " · ".join(healthy)]).strip()

    def changed(self, event: RunEvent) -> bool:
        """Take an event; True if the text is another one now."""
        before = self.text()
        if isinstance(event, FaultLatched):
            self._faults[event.robot] = event
        elif isinstance(event, ModeChanged):
            self._modes[event.robot] = event.mode
            if event.mode != "FAULT":
                self._faults.pop(event.robot, None)
        return self.text() != before

    @staticmethod
    def _fault(robot: str, event: FaultLatched) -> str:
        what = event.detail or event.message
        # A recording of a later version may have a fault that this one does not know.
        remedies = (page.remedy for fault, page in PAGES.items() if fault == event.fault)
        remedy = "".join(f"\n\nRemedy: {each}" for each in remedies)
        return f"# FAULT {event.fault} · {robot}: {what}{remedy}"
