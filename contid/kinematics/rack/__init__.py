"""Planar two-rack fingers (Morita et al.)."""
