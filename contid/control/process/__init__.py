"""The control process: deadlines, pipe from the daemon, records in shared memory."""
