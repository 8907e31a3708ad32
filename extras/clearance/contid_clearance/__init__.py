"""Bodies of robots kept apart, and away from obstacles: before motion and in every tick."""
