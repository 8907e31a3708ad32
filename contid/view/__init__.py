"""Pictures of a running robot or of a session, drawn by Rerun in a process that nothing waits for."""
