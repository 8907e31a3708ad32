"""Telemetry of a fleet in ROS 2, read only (extra ``contid[ros]``)."""
