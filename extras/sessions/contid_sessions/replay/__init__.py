"""Replay: recorded inputs through the present code, or recorded commands on the real buses."""
