"""The tick, its limits and states, the control process and the daemon."""
