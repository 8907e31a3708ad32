"""A simulated finger that meets an object: its servos feel it."""
