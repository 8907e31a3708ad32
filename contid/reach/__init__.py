"""Reachable sets of the robots of a file: exact regions in the plane, voxel volumes in space."""
