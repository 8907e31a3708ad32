"""A tendon robot simulated as a chain of rigid links: an oracle that shares nothing with the fitted model.

No arcs and no pull matrix: joints in the middle of links turn by Rodrigues' formula, a tendon is the polyline
through the holes of all discs, its length is measured in space. Dry friction is an elastoplastic element per
section that slips beyond a small bend. Each row is the minimum of the energy over all joints, by BFGS with
differences as gradient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from contid.kinematics.array import Array

LINKS = 4
SLIP_RAD = 1e-3


@dataclass(frozen=True)
class LinkRobot:
    """Two sections of three tendons; units and names as in the fit."""

    length_m: Array
    radius_m: Array
    angle_rad: Array
    twist_rad: float
    hardening_per_m: float
    offset_m: Array
    stiffness_m2: Array
    rest_rad: Array
    friction_m2: Array
    play_m: Array
    sheaths: bool = False

    def discs(self, joints: Array) -> tuple[Array, Array]:
        """Positions ``(batch, discs, 3)`` and frames of all discs of joints ``(batch, links, 2)``."""
        batch = len(joints)
        position, frame = np.zeros((batch, 3)), np.tile(np.eye(3), (batch, 1, 1))
        positions, frames = [position], [frame]
        for link in range(2 * LINKS):
            half = 0.5 * self.length_m[link // LINKS] / LINKS
            position = position + half * frame[:, :, 2]
            frame = frame @ _rodrigues(joints[:, link])
            position = position + half * frame[:, :, 2]
            positions.append(position)
            frames.append(frame)
        return np.stack(positions, axis=1), np.stack(frames, axis=1)

    def taken(self, joints: Array) -> Array:
        """Shortening of each tendon, ``(batch, 6)`` [m]."""
        position, frame = self.discs(joints)
        out = np.empty((len(joints), 6))
        for i in range(6):
            last = LINKS * (1 + i // 3)
            angle = np.full(2 * LINKS + 1, self.angle_rad[i])
            if i >= 3:
                angle[: LINKS + 1] += self.twist_rad
            hole = self.radius_m[i] * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
            # Between two discs a tendon runs at the azimuth it has in that section.
            if i >= 3:
                joined = hole[LINKS + 1]
            path = position + np.einsum("bdij,dj->bdi", frame, hole)
            steps = np.diff(path, axis=1)[:, :last]
            if i >= 3:
                start = position[:, LINKS] + frame[:, LINKS] @ joined
                steps[:, LINKS] = path[:, LINKS + 1] - start
            straight = self.length_m[: 1 + i // 3].sum()
            if self.sheaths and i >= 3:
                steps, straight = steps[:, LINKS:], self.length_m[1]
            out[:, i] = straight - np.sqrt((steps**2).sum(axis=2)).sum(axis=1)
        return out

    def energy(self, joints: Array, tight: Array, slipped: Array) -> Array:
        """Of each of a batch of joints."""
        rest = np.repeat(self.rest_rad.reshape(2, 2) / LINKS, LINKS, axis=0)
        spring = LINKS * np.repeat(self.stiffness_m2, LINKS)
        total = 0.5 * (spring * ((joints - rest) ** 2).sum(axis=2)).sum(axis=1)
        e = np.maximum(tight - self.taken(joints), 0.0)
        total += (e**2 / 2.0 + self.hardening_per_m * e**3 / 3.0).sum(axis=1)
        bends = joints.reshape(len(joints), 2, LINKS, 2).sum(axis=2)
        x = np.sqrt(((bends - slipped) ** 2).sum(axis=2))
        huber = np.where(x < SLIP_RAD, x**2 / (2.0 * SLIP_RAD), x - 0.5 * SLIP_RAD)
        return np.asarray(total + huber @ self.friction_m2)

    def tips(self, pull_m: Array) -> Array:
        """Tips along a recording, ``(rows, 3)`` [m]."""
        joints = np.repeat(self.rest_rad.reshape(2, 2) / LINKS, LINKS, axis=0)
        slipped, arrived = self.rest_rad.reshape(2, 2), pull_m[0]
        width = np.repeat(self.play_m, 3)
        out = []
        for pull in pull_m:
            arrived = np.where(pull - arrived > width, pull - width, arrived)
            arrived = np.where(arrived - pull > width, pull + width, arrived)
            joints = self._least(joints, arrived + self.offset_m, slipped)
            x = joints.reshape(2, LINKS, 2).sum(axis=1) - slipped
            size = np.maximum(np.sqrt((x**2).sum(axis=1, keepdims=True)), 1e-12)
            slipped = slipped + x * np.maximum(0.0, 1.0 - SLIP_RAD / size)
            out.append(self.discs(joints[None])[0][0, -1])
        return np.array(out)

    def _least(self, start: Array, tight: Array, slipped: Array) -> Array:
        n = start.size
        step = 1e-5 * np.eye(n).reshape(n, *start.shape)

        def both(flat: Array) -> tuple[float, Array]:
            here = flat.reshape(start.shape)
            batch = np.concatenate((here[None], here + step, here - step))
            found = 1e6 * self.energy(batch, tight, slipped)
            return float(found[0]), np.asarray((found[1 : n + 1] - found[n + 1 :]) / 2e-5)

        found = minimize(both, start.ravel(), jac=True, method="BFGS", options={"gtol": 1e-5, "maxiter": 200})
        return np.asarray(found.x).reshape(start.shape)


def _rodrigues(bend: Array) -> Array:
    """Turn by ``|bend|`` about the axis at a right angle to it, ``(batch, 3, 3)``."""
    theta = np.sqrt((bend**2).sum(axis=1))
    safe = np.maximum(theta, 1e-12)
    k = np.zeros((len(bend), 3, 3))
    k[:, 0, 2], k[:, 1, 2] = bend[:, 0] / safe, bend[:, 1] / safe
    k[:, 2, 0], k[:, 2, 1] = -k[:, 0, 2], -k[:, 1, 2]
    sin, cos = np.sin(theta)[:, None, None], np.cos(theta)[:, None, None]
    return np.asarray(np.eye(3) + sin * k + (1.0 - cos) * (k @ k))
