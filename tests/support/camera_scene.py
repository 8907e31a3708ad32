"""An arm's tip with three tags, a fixed tag and a camera, and a motion with known truth."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from contid_camera.camera import Camera
from contid_camera.setup_file import LoadedSetup, TrackSetup
from tests.support.camera_render import Lens, Studio, tag

#: Tags by number: size [mm], centre [mm], roll, pitch, yaw [deg]. The tip's z is along the body.
WORLD = {
    0: (50.0, (-75.0, 45.0, 0.0), (0.0, 0.0, 0.0)),
    1: (50.0, (75.0, 45.0, 0.0), (25.0, 0.0, 0.0)),
}
#: On the faces of a mount behind the tip, which points along the world's y in the middle of its motion.
TIP = {
    10: (22.0, (0.0, -15.0, -20.0), (90.0, 0.0, 0.0)),
    11: (22.0, (24.5, -6.0, -20.0), (90.0, 0.0, 40.0)),
    12: (22.0, (-24.5, -6.0, -20.0), (90.0, 0.0, -40.0)),
}


def rotation_of(roll, pitch, yaw):
    """Rz(yaw) Ry(pitch) Rx(roll) by scipy."""
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True).as_matrix()


def places(tags):
    keys = ("roll_deg", "pitch_deg", "yaw_deg")
    return [
        {
            "id": number, "size_mm": size,
            **dict(zip(("x_mm", "y_mm", "z_mm"), at, strict=True)), **dict(zip(keys, turn, strict=True)),
        }
        for number, (size, at, turn) in tags.items()
    ]  # fmt: skip


def setup(lens=None, **gate):
    """The setup of the scene, with the true lens or a calibrated one."""
    lens = Lens() if lens is None else lens
    camera = Camera(size_px=lens.size, focal_px=lens.focal, center_px=lens.center, distortion=lens.distortion)
    contents = {"contid_track": 1, "camera": "camera.yaml", "world": places(WORLD), "tip": places(TIP)}
    return LoadedSetup(TrackSetup.model_validate(contents | ({"gate": gate} if gate else {})), camera)


def prints(tags, only=None):
    """The tags as prints in their frame."""
    return [
        tag(number, size / 1e3, rotation_of(*turn), np.array(at) / 1e3)
        for number, (size, at, turn) in tags.items()
        if only is None or number in only
    ]


@dataclass
class Scene:
    """A camera 0.3 m above the plane of the world, looking down on it.

    Attributes:
        studio: renders.
        rotation: world to camera.
        origin: of the world in the camera [m].
    """

    studio: Studio
    rotation: np.ndarray
    origin: np.ndarray

    @classmethod
    def usual(cls, **of_studio):
        # x right, y up in the image: the camera's y is down and its z away from it.
        rotation = Rotation.from_euler("xyz", [180.0 + 6.0, 3.0, 4.0], degrees=True).as_matrix()
        return cls(Studio(**of_studio), rotation, np.array([-0.004, 0.012, 0.30]))

    def image(self, tip, rotation, rng, light=1.0, hidden=()):
        """The tip at a place in the world with a rotation tip to world."""
        tips = [each.moved(rotation, tip) for each in prints(TIP, TIP.keys() - set(hidden))]
        fixed = prints(WORLD, WORLD.keys() - set(hidden))
        return self.studio.image(
            [each.moved(self.rotation, self.origin) for each in (*tips, *fixed)], rng, light
        )


def motion(t):
    """Tip [m] and rotation tip to world at a time [s]: bends to both sides, rises and turns."""
    bend, lift = 0.55 * np.sin(1.3 * t), 0.25 * np.sin(0.7 * t + 1.0)
    base = Rotation.from_euler("x", -90.0, degrees=True)  # z along the world's y
    turned = Rotation.from_rotvec([lift, 0.0, -bend]) * base
    tip = np.array([0.05 * np.sin(1.3 * t), 0.01 + 0.02 * np.cos(0.9 * t), 0.055 + 0.02 * np.sin(0.7 * t)])
    return tip, turned.as_matrix()
