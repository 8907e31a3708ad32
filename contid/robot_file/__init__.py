"""Robot files: loading and validation, with the line and column of every mistake."""
