"""Pictures of a session or a running robot."""
