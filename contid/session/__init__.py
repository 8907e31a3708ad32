"""Recordings of runs: write, read, replay, compare, export."""
