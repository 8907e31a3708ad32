"""Arms among obstacles that the tests of avoidance share."""

import numpy as np
from scipy.spatial.transform import Rotation

from contid.kinematics.arc import arc
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.sections import Sections, backbone
from contid.kinematics.arc.solver import FORCE, ZONE, tuning_for
from contid_clearance.body import sampled_body
from contid_clearance.distances import to_obstacle
from contid_clearance.obstacles import Box, Capsule, Obstacle, Plane

RADIUS_M, MARGIN_M, FROM_M = 0.04, 0.005, 0.06
RACKS = (-np.pi, -np.pi / 3, -5 * np.pi / 3)


def racks(sections):
    """A tri-rack arm with platforms, rack budget and bend radius."""
    rigid = (0.030,) * (sections - 1) + (0.0,)
    chain = Sections((0.035,) * sections, (RACKS,) * sections, rigid)
    ends = (0.010,) * sections, (1.3 / sections,) * sections
    return Feasible(chain, *ends, rack_m=0.8, curvature_max=1 / 0.12)


def some_obstacles(rng, count=5):
    """A plane below the arm, spheres, capsules and boxes."""
    found: list[Obstacle] = [Plane(np.array([0.0, 0.0, -0.1]), np.array([0.0, 0.0, 1.0]))]
    while len(found) < count:
        at = rng.uniform([-0.3, -0.3, 0.2], [0.3, 0.3, 0.7])
        kind = rng.integers(3)
        if kind == 0:
            found.append(Capsule(at, at, rng.uniform(0.02, 0.06)))
        elif kind == 1:
            found.append(Capsule(at, at + rng.uniform(-0.1, 0.1, 3), rng.uniform(0.01, 0.04)))
        else:
            found.append(Box(at, Rotation.random(random_state=rng).as_matrix(), rng.uniform(0.015, 0.06, 3)))
    return found


def zone_and_force(feasible):
    """Of the potential [m], as `SectionModel.avoid` chooses them."""
    ell_m = tuning_for(feasible).ell_m
    return ZONE * ell_m, FORCE * ell_m


def avoiding(solver, feasible, obstacles):
    """A solver that avoids them."""
    rows = [each.packed.tolist() for each in obstacles]
    solver.avoid(rows, RADIUS_M, MARGIN_M, FROM_M, *zone_and_force(feasible))
    return solver


def potential(feasible, lengths, obstacles):
    """What avoidance adds to the distance from home, by its definition.

    ``F z f((r + m + z - d) / z)`` summed over twelve points of each arc beyond the begin of the body, the
    points of rigid pieces at most a radius apart, and all obstacles.
    """
    zone, force = zone_and_force(feasible)
    origin, frame, total = np.zeros(3), np.eye(3), 0.0
    for i, (u, v, length) in enumerate(feasible.sections.arcs(np.asarray(lengths))):
        begin = FROM_M / length if i == 0 else 0.0
        share = begin + (1.0 - begin) * np.arange(1, 13) / 12
        points, _ = arc.pose(share * u, share * v, share * length)
        end, turn = arc.pose(u, v, length)
        rigid = feasible.sections.rigid_m[i]
        if rigid > 0.0:
            count = int(np.clip(np.ceil(rigid / RADIUS_M), 1, 8))
            past = rigid * np.arange(1, count + 1)[:, None] / count
            points = np.concatenate((points, end + past * turn[:, 2]))
        for each in obstacles:
            x = (RADIUS_M + MARGIN_M + zone - each.signed_distance(origin + points @ frame.T)) / zone
            total += force * zone * float(np.sum(rise(x)))
        origin, frame = origin + frame @ (end + rigid * turn[:, 2]), frame @ turn
    return total


def rise(x):
    """``x^3 / (1 - x)`` from 0 to 0.9, and a parabola with its value, slope and curvature beyond."""
    at = np.clip(x, 0.0, 0.9)
    slope = (3.0 - 2.0 * at) * at**2 / (1.0 - at) ** 2
    curvature = (6.0 - 6.0 * at + 2.0 * at**2) * at / (1.0 - at) ** 3
    more = np.maximum(x - 0.9, 0.0)
    return at**3 / (1.0 - at) + more * slope + 0.5 * more**2 * curvature


def posture(feasible, rng):
    """A random one inside every limit."""
    return feasible.pulled(feasible.low + rng.random(len(feasible.low)) * (feasible.high - feasible.low))


def gap_m(feasible, lengths, obstacles):
    """Certain lower bound of the distance of the body from the nearest obstacle."""
    whole = sampled_body(lambda count: backbone(feasible.sections, np.array(lengths), count), RADIUS_M)
    body = whole.part(FROM_M, whole.pieces * whole.spacing_m)
    return min(to_obstacle(body, each).lower_m for each in obstacles)
