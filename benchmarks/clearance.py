"""Processor time of distances between random chains of arcs, by the kernel."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from contid_clearance.body import Body, sampled_body
from contid_clearance.distances import between_bodies, to_obstacle
from contid_clearance.obstacles import Box
from tests.clearance.arcs import random_chain

PAIRS = 300
MARGIN_M = 1e-3


def times_us(pairs: list[tuple[Body, Body]], distance: Callable[[Body, Body], object], repeat: int) -> str:
    """Median and 90th percentile of one call."""
    found = []
    for a, b in pairs:
        distance(a, b)
        begin = time.process_time_ns()
        for _ in range(repeat):
            distance(a, b)
        found.append((time.process_time_ns() - begin) / repeat / 1e3)
    return f"median {np.median(found):7.1f} us, p90 {np.percentile(found, 90):7.1f} us"


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(0)
    chain: Callable[..., Any] = random_chain  # of the tests, without types
    chains = [(chain(rng, 0.12), chain(rng, 0.12)) for _ in range(PAIRS)]
    pairs = [(sampled_body(a.evenly, 0.01), sampled_body(b.evenly, 0.01)) for a, b in chains]
    sections = np.mean([len(a.lengths) * len(b.lengths) for a, b in chains])
    box = Box(np.zeros(3), np.eye(3), np.full(3, 0.03))
    print(f"{PAIRS} pairs of arms of one to three arcs, {sections:.1f} pairs of sections each")
    print("two arms             ", times_us(pairs, between_bodies, 20))
    print("only the margin      ", times_us(pairs, lambda a, b: between_bodies(a, b, MARGIN_M), 20))
    print("arm and box          ", times_us(pairs, lambda a, _: to_obstacle(a, box), 20))


if __name__ == "__main__":
    main()
