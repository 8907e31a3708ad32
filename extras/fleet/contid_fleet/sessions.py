"""Which sessions of operators are linked: the tokens that a bridge sees."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Final

from contid_fleet.keys import Origin

#: A token may come after the first request of its session: zenoh orders declarations and queries apart.
TOKEN_TIMEOUT_S: Final = 1.0


class Sessions:
    """Tokens of the sessions of operators."""

    def __init__(self) -> None:
        self._tokens: set[Origin] = set()
        self._changed = asyncio.Event()

    def change(self, origin: Origin, alive: bool) -> None:
        """Note a token that appeared or disappeared."""
        (self._tokens.add if alive else self._tokens.discard)(origin)
        self._changed.set()
        self._changed = asyncio.Event()

    def present(self, origin: Origin) -> bool:
        """True for a session with a token."""
        return origin in self._tokens

    async def appears(self, origin: Origin) -> bool:
        """Wait for the token of a session; False when it does not come."""
        with suppress(TimeoutError):
            async with asyncio.timeout(TOKEN_TIMEOUT_S):
                while not self.present(origin):
                    await self._changed.wait()
        return self.present(origin)
