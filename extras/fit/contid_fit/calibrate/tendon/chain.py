"""The tip as a function of bends, lengths and the mounting of a recorded robot, with derivatives.

The recorded tip is a marker: ``tip = base + R(tilt) (p(Theta, l) + R_p(Theta, l) marker)``, with position p
and rotation R_p of the end of a chain of arcs with bends Theta and lengths l. Two bends per section, the
components of its bending angle (`contid.kinematics.arc.arc`). Vectorised over rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from contid.kinematics.arc import arc
from contid.kinematics.array import Array
from contid_fit.calibrate.tendon.arc_jacobians import jacobians


class Mounting(NamedTuple):
    """Where the robot stands in the frame of the tracker.

    Attributes:
        base_m: start of section 1.
        tilt_rad: turn of the base about x and y of the tracker's frame.
        marker_m: offset of the marker at the tip, along x and y of the tip frame.
    """

    base_m: Array
    tilt_rad: Array
    marker_m: Array


class TipRows(NamedTuple):
    """Tips and derivatives of every row.

    Attributes:
        tip_m: ``(rows, 3)``.
        by_bend: ``(rows, 3, 2 sections)``.
        by_length: ``(rows, 3, sections)``.
        by_base, by_tilt, by_marker: ``(rows, 3, 3)``, ``(rows, 3, 2)``, ``(rows, 3, 2)``.
    """

    tip_m: Array
    by_bend: Array
    by_length: Array
    by_base: Array
    by_tilt: Array
    by_marker: Array


def tips(bends: Array, length_m: Array, mounting: Mounting) -> TipRows:
    """Tips of bends ``(rows, 2 sections)`` [rad] and lengths ``(sections,)`` [m]."""
    rows, sections = len(bends), len(length_m)
    tilt, tilt_jacobian = _tilt(mounting.tilt_rad)
    position, rotation = np.zeros((rows, 3)), np.broadcast_to(np.eye(3), (rows, 3, 3))
    starts, ends, locals_ = [], [], []
    for k in range(sections):
        u, v, length = bends[:, 2 * k], bends[:, 2 * k + 1], np.array(length_m[k])
        p, r = arc.pose(u, v, length)
        starts.append(rotation)
        position = position + (rotation @ p[..., None])[..., 0]
        rotation = rotation @ r
        ends.append(position)
        locals_.append(jacobians(u, v, length))
    marker = np.array([*mounting.marker_m, 0.0])
    tip = position + rotation @ marker
    by_bend, by_length = np.empty((rows, 3, 2 * sections)), np.empty((rows, 3, sections))
    for k, (start, end, (linear, angular)) in enumerate(zip(starts, ends, locals_, strict=True)):
        lever = (np.swapaxes(start, 1, 2) @ (tip - end)[..., None])[..., 0]
        turned = np.cross(angular, lever[:, :, None], axisa=1, axisb=1, axisc=1)
        by_both = tilt @ start @ (linear + turned)
        by_bend[:, :, 2 * k : 2 * k + 2] = by_both[:, :, :2]
        by_length[:, :, k] = by_both[:, :, 2]
    by_tilt = np.stack([tip @ by_angle.T for by_angle in tilt_jacobian], axis=-1)
    by_base = np.broadcast_to(np.eye(3), (rows, 3, 3))
    return TipRows(
        mounting.base_m + tip @ tilt.T, by_bend, by_length, by_base, by_tilt, tilt @ rotation[:, :, :2]
    )


def _tilt(angles: Array) -> tuple[Array, tuple[Array, Array]]:
    """``Ry Rx`` and its derivatives by the turns about x and y."""
    (cx, cy), (sx, sy) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    by_x = np.array([[0.0, 0.0, 0.0], [0.0, -sx, -cx], [0.0, cx, -sx]])
    by_y = np.array([[-sy, 0.0, cy], [0.0, 0.0, 0.0], [-cy, 0.0, -sy]])
    return about_y @ about_x, (about_y @ by_x, by_y @ about_x)
