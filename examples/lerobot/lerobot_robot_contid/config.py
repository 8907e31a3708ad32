"""What LeRobot's command line takes: ``--robot.type=contid --robot.socket=PATH``."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("contid")
@dataclass(kw_only=True)
class ContidRobotConfig(RobotConfig):
    """Robots that follow actions.

    Attributes:
        socket: of the daemon; None for the only one that runs.
        rate_hz: at which the newest action goes to the daemon, whatever the rate of LeRobot's loop.
    """

    socket: str | None = None
    rate_hz: float = 50.0


@TeleoperatorConfig.register_subclass("contid")
@dataclass(kw_only=True)
class ContidLeaderConfig(TeleoperatorConfig):
    """Robots that are moved by hand, or by a program, and whose measured axes are the actions.

    Attributes:
        socket: of the daemon; None for the only one that runs.
    """

    socket: str | None = None
