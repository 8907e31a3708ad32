"""Shapes in space of a Rerun recording."""
