"""From an image to a measured tip, or to the reason why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid.targets import Vec3
from contid.units import MM_PER_M
from contid_camera.body_pose import BodyPose, alike, solve_pose
from contid_camera.jumps import JumpGate
from contid_camera.setup_file import LoadedSetup, corners_of
from contid_camera.tags import SeenTag, TagDetector

#: The corners of a fixed tag are averaged over this number of images.
AVERAGED: Final = 200
#: After this number of images the pose of the world follows the averages, which go with a camera that creeps.
SOLVED_IMAGES: Final = 20
#: A fixed tag that is this far from its average has moved, or the camera has [px].
MOVED_PX: Final = 2.0
#: After this number of images with a moved tag its average begins again.
MOVED_IMAGES: Final = 5


@dataclass(frozen=True, eq=False, slots=True)
class MeasuredTip:
    """A pose of the tip.

    Attributes:
        time_s: time of the capture.
        tip_m: tip in the world.
        direction: direction of the body there, in the world.
        rotation: tip to world, shape ``(3, 3)``.
        error_px: root mean square of the corners.
        tip_sd_m: standard deviation of the tip, without that of the fixed tags.
        tags: that were used.
    """

    time_s: float
    tip_m: Vec3
    direction: Vec3
    rotation: Array
    error_px: float
    tip_sd_m: float
    tags: tuple[int, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Look:
    """The result of an image.

    Attributes:
        seen: tags in it, by number.
        tip: measured, None when it is refused or not seen.
        refusal: why there is none, "" when there is.
        body: pose of the tip in the camera, also of a refused one.
        world: pose of the world in the camera, None before the fixed tags were seen.
    """

    seen: dict[int, SeenTag]
    tip: MeasuredTip | None
    refusal: str
    body: BodyPose | None
    world: BodyPose | None


class TipTracker:
    """Measures the tip in images of one camera that does not move.

    Args:
        loaded: setup and camera.
    """

    def __init__(self, loaded: LoadedSetup) -> None:
        setup = loaded.setup
        self._gate = setup.gate
        self._matrix = loaded.camera.matrix
        self._world, self._tip = corners_of(setup.world), corners_of(setup.tip)
        self._detector = TagDetector(loaded.camera, self._world.keys() | self._tip.keys())
        #: Images in the average of each fixed tag, up to `AVERAGED`, and its mean corners [px].
        self._fixed: dict[int, tuple[int, Array]] = {}
        #: For how many images in a row a fixed tag was not where it was.
        self._moved: dict[int, int] = {}
        #: Pose of the world in the camera, and the number of images since it was solved.
        self._world_pose: BodyPose | None = None
        self._solved_ago = 0
        self._jumps: JumpGate[MeasuredTip] = JumpGate(setup.gate)

    def look(self, image: Array, time_s: float) -> Look:
        """Measure the tip in an image.

        Args:
            image: grey values, shape ``(height, width)``, bytes.
            time_s: time of its capture; does not go back.
        """
        seen = self._detector.find(image)
        moved = self._average(seen)
        world = self._world_pose
        last = self._jumps.last
        near = None if last is None or world is None else world.rotation @ last.rotation
        ideal = {tag: each.ideal_px for tag, each in seen.items()}
        body = solve_pose(self._tip, ideal, self._matrix, near)
        if moved is not None:
            return Look(seen, None, f"tag {moved} or the camera has moved", body, world)
        if world is None:
            return Look(seen, None, "no fixed tag was seen yet", body, world)
        if body is None:
            return Look(seen, None, "no tag of the tip is seen", body, world)
        measured = self._measured(body, world, time_s)
        refusal = self._refusal(body, measured)
        return Look(seen, None if refusal else measured, refusal, body, world)

    def _average(self, seen: dict[int, SeenTag]) -> int | None:
        """Take the fixed tags of an image into the averages; the number of one that has moved, else None."""
        changed, moved = False, None
        for tag in self._world.keys() & seen.keys():
            ideal = seen[tag].ideal_px
            count, mean = self._fixed.get(tag, (0, ideal))
            if float(np.abs(ideal - mean).max()) > MOVED_PX:
                moved = tag
                self._moved[tag] = self._moved.get(tag, 0) + 1
                if self._moved[tag] < MOVED_IMAGES:
                    continue
                count, mean = 0, ideal
                # Where the camera has moved, a tag that is hidden now stands elsewhere in the next images.
                self._fixed = {other: kept for other, kept in self._fixed.items() if other in seen}
            self._moved[tag] = 0
            weight = min(count + 1, AVERAGED)
            self._fixed[tag] = (weight, mean + (ideal - mean) / weight)
            changed = changed or weight < AVERAGED
        self._solved_ago += 1
        if changed or self._solved_ago >= SOLVED_IMAGES:
            self._solved_ago = 0
            near = None if self._world_pose is None else self._world_pose.rotation
            places = {tag: mean for tag, (_, mean) in self._fixed.items()}
            self._world_pose = solve_pose(self._world, places, self._matrix, near)
        return moved

    def _measured(self, body: BodyPose, world: BodyPose, time_s: float) -> MeasuredTip:
        rotation = world.rotation.T @ body.rotation
        tip = world.rotation.T @ (body.origin_m - world.origin_m)
        sd_m = math.sqrt(float(np.trace(body.covariance[3:, 3:])))
        x, y, z = tip.tolist()
        dx, dy, dz = rotation[:, 2].tolist()
        return MeasuredTip(time_s, (x, y, z), (dx, dy, dz), rotation, body.error_px, sd_m, body.tags)

    def _refusal(self, body: BodyPose, measured: MeasuredTip) -> str:
        """Why a pose is refused; "" when it is taken."""
        gate = self._gate
        if body.error_px > gate.error_px:
            return f"the corners are {body.error_px:.2f} px off; gate.error_px is {gate.error_px:g}"
        sd_mm = measured.tip_sd_m * MM_PER_M
        if sd_mm > gate.tip_sd_mm:
            return f"the tip is only known to {sd_mm:.2f} mm; gate.tip_sd_mm is {gate.tip_sd_mm:g}"
        ambiguous = alike(body, body.other)
        if ambiguous and self._jumps.last is None:
            return "two poses look alike"
        return self._jumps.refusal(measured, certain=not ambiguous)
