"""Robot files: what a lab writes, validated, with the line and column of every mistake."""
