"""Named poses, sequences of them, and recordings of robots that are moved by hand."""
