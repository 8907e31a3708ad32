"""Arms among obstacles that the tests of avoidance share."""

import numpy as np
from scipy.spatial.transform import Rotation

from contid.clearance.body import sampled_body
from contid.clearance.distance import to_obstacle
from contid.clearance.obstacles import Box, Capsule, Obstacle, Plane
from contid.kinematics.arc.avoid import FORCE, ZONE, Avoid
from contid.kinematics.arc.feasible import Feasible
from contid.kinematics.arc.sections import Sections, backbone
from contid.kinematics.arc.task import tuning_for

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


def around(feasible, obstacles):
    """What `SectionModel.avoid` makes of obstacles."""
    ell_m = tuning_for(feasible).ell_m
    rows = np.array([each.packed for each in obstacles])
    return Avoid(rows, RADIUS_M, MARGIN_M, FROM_M, ZONE * ell_m, FORCE * ell_m)


def avoiding(solver, feasible, obstacles):
    """A solver that avoids them."""
    a = around(feasible, obstacles)
    solver.avoid(a.obstacles.tolist(), a.radius_m, a.margin_m, a.from_m, a.zone_m, a.force_m)
    return solver


def posture(feasible, rng):
    """A random one inside every limit."""
    return feasible.pulled(feasible.low + rng.random(len(feasible.low)) * (feasible.high - feasible.low))


def gap_m(feasible, lengths, obstacles):
    """Certain lower bound of the distance of the body from the nearest obstacle."""
    whole = sampled_body(lambda count: backbone(feasible.sections, np.array(lengths), count), RADIUS_M)
    body = whole.part(FROM_M, whole.pieces * whole.spacing_m)
    return min(to_obstacle(body, each).lower_m for each in obstacles)
