"""What the socket needs of the recordings of a run; `contid.session.recordings` has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol


class RunRecordings(Protocol):
    """Recordings that clients begin and end; they name no path."""

    async def begin(self, by: str) -> tuple[Path, bool]:
        """Begin a recording for a client; its file, and whether ticks are written already.

        Raises:
            ContidError: there is one, or its file cannot be written.
        """

    async def end(self, by: str) -> tuple[Path, bool]:
        """End it; its file, and whether that is complete already.

        Raises:
            ContidError: there is none.
        """

    def watch(self) -> None:
        """Look after recorders that have ended; called periodically."""

    def as_fields(self) -> list[dict[str, Any]]:
        """Every recording under way, for ``status``."""
