"""The exchange of a tick with every servo: its registers, its answers, its waiting times."""
