"""Where the robots of a file can go: exact regions in the plane, sampled volumes in space."""
