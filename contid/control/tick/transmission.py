"""Transmissions: actuation of the model to device values, and back.

    driven = C actuation          C: the robot's coupling, identity for most robots
    device_i = f_i(driven_i)      f_i: pinion, table or identity, per axis

Actuation is in m or Pa in the order of the model, device values are in rad or Pa in the same order. Samples
go back through ``f_i^-1`` and ``C^-1``, which is computed once. Everything in the tick is plain floats and
tuples, which is faster than NumPy for two to twelve axes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from contid.control.tick.monotone_cubic import MonotoneCubic
from contid.robot_file.base import AxisDescription
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.units import BAR, DEG, MM_PER_M

#: A matrix as its rows, each row as its non-zero (column, factor) pairs.
_Sparse: TypeAlias = tuple[tuple[tuple[int, float], ...], ...]


#: From a driven length or pressure [m or Pa] to the value of a device [rad or Pa], and exactly back.
AxisMap: TypeAlias = tuple[Callable[[float], float], Callable[[float], float]]


@dataclass(frozen=True, slots=True)
class Gear:
    """A pinion, a spool or the identity: ``device = zero + gain * driven``.

    Attributes:
        zero: of the device, where nothing is driven [rad or Pa].
        gain: of its value by what it drives.
    """

    zero: float
    gain: float

    def to_device(self, driven: float) -> float:
        """Value of the device."""
        return self.zero + self.gain * driven

    def to_driven(self, device: float) -> float:
        """What the device drives."""
        return (device - self.zero) / self.gain


def axis_map(axis: AxisDescription) -> AxisMap:
    """The map of a checked axis description: its measured table, else its gear."""
    if axis.mm_to_bar is not None:
        lengths_m, pressures_pa = zip(
            *((mm / MM_PER_M, bar * BAR) for mm, bar in axis.mm_to_bar), strict=True
        )
        curve = MonotoneCubic(lengths_m, pressures_pa)
        return curve, curve.inverse
    gear = gear_of(axis)
    return gear.to_device, gear.to_driven


def gear_of(axis: AxisDescription) -> Gear:
    """The gear of an axis without a table."""
    gain = float(axis.direction)
    if axis.mm_per_rev is not None:
        gain *= 2.0 * math.pi * MM_PER_M / axis.mm_per_rev
    return Gear(axis.zero_deg * DEG, gain)


class RobotTransmission:
    """All axes of one robot, as described in a checked robot file.

    Attributes:
        axis_names: the model's axes, then the extra axes: the order of every tuple here.
        maps: one `AxisMap` per name. The coupling mixes the model's axes only; an extra axis without
            ``mm_per_rev`` or table has the value of its column.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.axis_names = description.all_axis_names
        axes = description.axes
        self.maps: tuple[AxisMap, ...] = tuple(axis_map(axes[name]) for name in self.axis_names)
        gears = [gear_of(axes[name]) for name in self.axis_names if axes[name].mm_to_bar is None]
        #: Zero and gain of every axis, where all have a gear: no call per axis in the tick.
        self._gears = [(gear.zero, gear.gain) for gear in gears] if len(gears) == len(self.maps) else None
        coupled = len(description.axis_names)
        extra = range(coupled, len(self.axis_names))
        self._forward, self._backward = (
            None if rows is None else (*rows, *(((axis, 1.0),) for axis in extra))
            for rows in _coupling(description.coupling)
        )
        self._driven = description.driven_limits

    def to_device(self, actuation: Actuation) -> tuple[float, ...]:
        """Device values [rad or Pa] that realise an actuation [m or Pa]."""
        driven = actuation if self._forward is None else _multiply(self._forward, actuation)
        if self._gears is not None:
            return tuple(
                [zero + gain * value for (zero, gain), value in zip(self._gears, driven, strict=True)]
            )
        return tuple([to_device(value) for (to_device, _), value in zip(self.maps, driven, strict=True)])

    def to_actuation(self, device: Sequence[float]) -> Actuation:
        """The actuation [m or Pa] that device values [rad or Pa] stand for."""
        driven = tuple([to_driven(value) for (_, to_driven), value in zip(self.maps, device, strict=True)])
        return driven if self._backward is None else _multiply(self._backward, driven)

    def travel(self) -> tuple[tuple[float, float], ...]:
        """Min and max device value of every axis over the robot's limits [rad or Pa]."""
        ends = []
        for (to_device, _), limits in zip(self.maps, self._driven, strict=True):
            low, high = sorted(map(to_device, limits))
            ends.append((low, high))
        return tuple(ends)


def _coupling(matrix: tuple[tuple[float, ...], ...] | None) -> tuple[_Sparse | None, _Sparse | None]:
    """The coupling and its inverse as sparse rows; None twice for the identity."""
    if matrix is None:
        return None, None
    return _sparse(matrix), _sparse(np.linalg.inv(np.array(matrix)).tolist())


def _sparse(matrix: Sequence[Sequence[float]]) -> _Sparse:
    return tuple(tuple((j, float(c)) for j, c in enumerate(row) if c != 0.0) for row in matrix)


def _multiply(rows: _Sparse, vector: Sequence[float]) -> tuple[float, ...]:
    return tuple([sum([c * vector[j] for j, c in row]) for row in rows])
