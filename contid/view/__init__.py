"""Drawing a running robot or a session with Rerun, in a process that the control loop never waits for."""
