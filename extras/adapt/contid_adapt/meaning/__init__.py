"""What the columns of a table mean: time, units, directions, lost and repeated samples."""
