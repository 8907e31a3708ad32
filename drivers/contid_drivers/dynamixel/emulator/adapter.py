"""The USB adapter of an emulated bus: when the bytes that the servos sent arrive at the host.

Bytes keep their order, as in a real adapter. Times are monotonic [s].
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(slots=True)
class Adapter:
    """Delays of an adapter and of the host's scheduler; 0 is none.

    Attributes:
        late_s: constant lateness of everything.
        latency_s: latency timer: bytes arrive at multiples of it only (an FTDI's factory value is 16 ms).
        chunk: bytes per delivery; each piece arrives when its own last byte was on the wire.
        stalled_until: nothing arrives before this time, then everything at once (a hiccup of the host).
    """

    late_s: float = 0.0
    latency_s: float = 0.0
    chunk: int = 0
    stalled_until: float = 0.0

    def arrivals(
        self, at: float, wire: bytes, byte_s: float, ends: tuple[int, ...] = ()
    ) -> list[tuple[float, bytes]]:
        """Pieces of an answer and their arrival times.

        Args:
            at: time of its last byte on the wire.
            wire: the answer.
            byte_s: time of one byte on the wire.
            ends: ends of the parts that arrive by themselves; none for the whole answer at once.
        """
        whole = len(wire)
        if self.chunk:
            ends = (*range(self.chunk, whole, self.chunk), whole)
        ends = ends or (whole,)
        starts = (0, *ends)
        return [
            (self._arrival(at - (whole - end) * byte_s), wire[start:end])
            for start, end in zip(starts, ends, strict=False)
        ]

    def _arrival(self, at: float) -> float:
        at += self.late_s
        if self.latency_s:
            at = math.ceil(at / self.latency_s) * self.latency_s
        return max(at, self.stalled_until)
