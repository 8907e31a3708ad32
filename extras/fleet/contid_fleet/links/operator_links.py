"""The local connections of the sessions of operators to one node, at most `MAX_SESSIONS`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from contid_fleet.keys import Origin
from contid_fleet.links.operator_link import OperatorLink
from contid_fleet.sessions import Sessions

#: Sessions with a connection of their own; stops of others use that of the bridge.
MAX_SESSIONS: Final = 16
#: A connection of a session without a token is closed after this time without a request [s].
IDLE_S: Final = 10.0


class OperatorLinks:
    """Connections by session, each made when it is asked for.

    Args:
        path: path of the daemon's socket.
        sessions: sessions of operators, with their tokens.
        noticed: called with the session and each line of the daemon for it that is no response; False for
            telemetry.
    """

    def __init__(
        self, path: Path, sessions: Sessions, noticed: Callable[[Origin, bytes, bool], None]
    ) -> None:
        self._path = path
        self._sessions = sessions
        self._noticed = noticed
        self._links: dict[Origin, OperatorLink] = {}

    def link(self, origin: Origin) -> OperatorLink | None:
        """The connection of a session; None where it has none and there are `MAX_SESSIONS` others."""
        if origin not in self._links:
            if len(self._links) >= MAX_SESSIONS:
                return None
            self._links[origin] = OperatorLink(
                self._path, origin, lambda line, urgent: self._noticed(origin, line, urgent)
            )
        return self._links[origin]

    def end(self, origin: Origin) -> None:
        """Close the connection of a session, if there is one: if it held the lease, the robots hold."""
        link = self._links.pop(origin, None)
        if link is not None:
            link.close()

    def end_idle(self) -> None:
        """Close the connections that have neither a token nor a request within `IDLE_S`."""
        before_s = time.monotonic() - IDLE_S
        for origin, link in tuple(self._links.items()):
            if link.used_s < before_s and not self._sessions.present(origin):
                self.end(origin)

    def end_all(self) -> None:
        """Close every connection."""
        for origin in tuple(self._links):
            self.end(origin)
