"""Studies of the recordings of real robots in motion."""
