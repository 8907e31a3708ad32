"""Robots of a running contid daemon as a robot and as a leader of LeRobot, both of type ``contid``.

LeRobot imports this package by its name, and finds a device here by its class: that of its configuration
less "Config".
"""

from lerobot_robot_contid.config import ContidLeaderConfig, ContidRobotConfig
from lerobot_robot_contid.devices import ContidLeader, ContidRobot

__all__ = ["ContidLeader", "ContidLeaderConfig", "ContidRobot", "ContidRobotConfig"]
