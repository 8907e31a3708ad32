"""The rope between two arms: catenary and closed chain."""
