"""Frames along a rod in equilibrium, and the arc lengths that make a fine polyline of it."""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array
from contid.kinematics.cosserat.element import RodState, link, step
from contid.kinematics.cosserat.loads import Loads
from contid.kinematics.cosserat.section import Rod
from contid.kinematics.cosserat.spatial import cross

#: Points of a polyline per element.
POINTS_PER_ELEMENT = 12


def frames_at(
    rod: Rod, pressures: Array, base_moment: Array, loads: Loads, elements: int, stations: Array
) -> Array:
    """Position [mm] and rotation, row by row, at ascending reference arc lengths [mm], shape (n, 12).

    A station inside an element is reached by one step from its start. Specification of
    ``contid/kernels/cosserat/stations.hpp``.
    """
    none = np.zeros((3, 0))
    state = RodState(np.eye(3), np.zeros(3), np.array(base_moment, float), none, none, none)
    N = loads.base_force(rod)
    frames: list[Array] = []

    def write(at: RodState) -> None:
        frames.append(np.concatenate([at.p, at.R.ravel()]))

    begin = 0.0
    for i, section in enumerate(rod.sections):
        inflated = section.inflated(pressures[3 * i : 3 * i + 3])
        f = loads.weight.get(i, np.zeros(3))
        h = section.length / elements
        for k in range(elements):
            while len(frames) < len(stations) and stations[len(frames)] < begin + (k + 1) * h:
                part = stations[len(frames)] - (begin + k * h)
                write(step(inflated, state, N, f, part, None, False))
            state = step(inflated, state, N, f, h, None, False)
            N = N - h * f
        begin += section.length
        force = loads.joint_force.get(i, np.zeros(3))
        state.mu = state.mu - loads.joint_moment.get(i, np.zeros(3)) - cross(state.p, force)
        N = N - force
        if section.link > 0.0:
            f = loads.link_weight.get(i, np.zeros(3))
            while len(frames) < len(stations) and stations[len(frames)] < begin + section.link:
                write(link(state, stations[len(frames)] - begin, f))
            state = link(state, section.link, f)
            N = N - section.link * f
            begin += section.link
    while len(frames) < len(stations):
        write(state)
    return np.array(frames).reshape(len(stations), 12)


def stations(rod: Rod, elements: int) -> Array:
    """Reference arc lengths [mm] of a fine polyline: equal parts of every element, and the ends of links."""
    found, begin = [np.zeros(1)], 0.0
    for section in rod.sections:
        parts = elements * POINTS_PER_ELEMENT
        found.append(begin + section.length * np.arange(1, parts + 1) / parts)
        begin += section.length + section.link
        if section.link > 0.0:
            found.append(np.array([begin]))
    return np.concatenate(found)
