"""Distances between bodies of robots and to obstacles, bounded from below."""
