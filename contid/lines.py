"""The bound on lines of text that contid reads: rows of trajectories, requests and responses on a socket."""

from __future__ import annotations

from typing import Final

#: Characters or bytes. A row of sixteen fingers has about a thousand characters.
MAX_LINE: Final = 1 << 16
