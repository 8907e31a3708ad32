"""Tendons with load cells on the linked core: a plant of its own, random moves, faults."""
