"""Watches a feed: the robots of a machine hold when the feed of a named operator station stops.

The program of the operator itself feeds, in its own loop. Before the first feed nothing happens; after a hold
the next feed begins it anew.
"""

from __future__ import annotations


class FeedWatch:
    """The feed of one operator; `feed` may be called from any thread.

    Args:
        operator: whose feed counts.
        after_s: the robots hold this long after the last feed.
    """

    def __init__(self, operator: str, after_s: float) -> None:
        self.operator = operator
        self.after_s = after_s
        self._fed_s: float | None = None

    def feed(self, operator: str, now_s: float) -> bool:
        """Note a feed; False when it is that of another operator, which does not count."""
        if operator != self.operator:
            return False
        self._fed_s = now_s
        return True

    def lapsed(self, now_s: float) -> bool:
        """True once after the feed has stopped."""
        fed_s = self._fed_s
        if fed_s is None or now_s - fed_s <= self.after_s:
            return False
        self._fed_s = None
        return True
