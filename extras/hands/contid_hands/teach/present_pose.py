"""The present pose of robots as a target: measured axes, moved inside their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from contid.remote.client.described_robot import DescribedRobot

#: Beyond a limit by less than this share of the travel is noise of an encoder.
NOISE_SHARE: Final = 1e-3


def present_pose(
    robots: Sequence[DescribedRobot], measured: Sequence[float]
) -> tuple[dict[str, float], list[str]]:
    """The target of a pose that is saved now.

    Args:
        robots: whose pose it is.
        measured: their axes, one robot after the other, in their units.

    Returns:
        Columns with their values, and a message for each value that was outside its limits.
    """
    columns = [column for robot in robots for column in robot.axes]
    minimum = [low for robot in robots for low in robot.minimum]
    maximum = [high for robot in robots for high in robot.maximum]
    target, messages = {}, []
    for column, value, low, high in zip(columns, measured, minimum, maximum, strict=True):
        target[column] = min(max(value, low), high)
        if abs(target[column] - value) > NOISE_SHARE * (high - low):
            messages.append(f"{column} {value:.2f} is outside its limits; saved as {target[column]:g}")
    return target, messages
