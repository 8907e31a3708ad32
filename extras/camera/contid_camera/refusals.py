"""Counts of the poses that a tracker refused, for its report."""

from __future__ import annotations

from collections import Counter


class Refusals:
    """Numbers of refused poses by their reason."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def add(self, refusal: str) -> None:
        """Count a refusal: those that differ in their numbers, or behind a semicolon, are one."""
        parts = refusal.split("; ")[0].split()
        self._counts[" ".join(part for part in parts if not part[0].isdigit())] += 1

    def lines(self) -> list[str]:
        """A line for each reason, the most frequent first."""
        return [f"  {count} not: {reason}" for reason, count in self._counts.most_common()]
