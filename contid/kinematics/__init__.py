"""Kinematic and static models: pure arithmetic in SI."""
