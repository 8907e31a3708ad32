"""Random chains of arcs by scipy's rotations, independent of contid's kinematics."""

import numpy as np
from scipy.spatial.transform import Rotation


class ArcChain:
    """Arcs tangent to each other; the first starts at ``origin`` along the third column of ``rotation``."""

    def __init__(self, lengths, curvatures, origin, rotation):
        self.lengths, self.curvatures = np.asarray(lengths), np.asarray(curvatures)
        self.ends = np.concatenate([[0.0], np.cumsum(self.lengths)])
        self.points, self.frames = [np.asarray(origin)], [rotation]
        for length, curvature in zip(self.lengths, self.curvatures, strict=True):
            point, frame = _arc(curvature, np.array([length]))
            self.points.append(self.points[-1] + self.frames[-1].apply(point[0]))
            self.frames.append(self.frames[-1] * frame[0])

    @property
    def length(self):
        return self.ends[-1]

    def at(self, s):
        """Points at arc lengths, shape (n, 3)."""
        s = np.atleast_1d(np.asarray(s, float))
        which = np.clip(np.searchsorted(self.ends, s, side="right") - 1, 0, len(self.lengths) - 1)
        found = np.empty((len(s), 3))
        for k in range(len(self.lengths)):
            mine = which == k
            if mine.any():
                point, _ = _arc(self.curvatures[k], s[mine] - self.ends[k])
                found[mine] = self.points[k] + self.frames[k].apply(point)
        return found

    def evenly(self, count):
        return self.at(np.linspace(0.0, self.length, count))


def random_chain(rng, spread_m=0.3):
    """One to three arcs of 20 to 200 mm with bends up to 200 degrees."""
    arcs = rng.integers(1, 4)
    lengths = rng.uniform(0.02, 0.2, arcs)
    angles = rng.uniform(-3.5, 3.5, arcs) * (rng.random(arcs) > 0.1)  # some are straight
    planes = rng.uniform(0.0, np.pi, arcs)
    curvatures = (angles / lengths)[:, None] * np.stack([np.cos(planes), np.sin(planes)], axis=1)
    return ArcChain(
        lengths, curvatures, rng.uniform(-spread_m, spread_m, 3), Rotation.random(random_state=rng)
    )


def _arc(curvature, s):
    """Points and frames of one arc: its curvature vector is the axis of rotation per length."""
    k = np.hypot(*curvature)
    axis = np.array([curvature[0], curvature[1], 0.0])
    frames = Rotation.from_rotvec(s[:, None] * axis)
    if k < 1e-9:
        return np.outer(s, [0.0, 0.0, 1.0]), frames
    # The integral of the tangent: sin(ks)/k along z and (1 - cos(ks))/k towards the centre.
    towards = np.cross(axis / k, [0.0, 0.0, 1.0])
    return np.outer(np.sin(k * s) / k, [0.0, 0.0, 1.0]) + np.outer((1.0 - np.cos(k * s)) / k, towards), frames
