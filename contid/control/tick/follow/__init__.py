"""How far a body may be from its commands: the response of its axes, and the range that follows from it."""
