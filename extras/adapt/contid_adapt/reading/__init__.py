"""From the bytes of a file to named columns, each cell with its place in the file."""
