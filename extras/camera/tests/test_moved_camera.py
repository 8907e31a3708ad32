"""The pose of the world after the camera has moved while a fixed tag was hidden."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from contid.kinematics.array import Array
from contid_camera.camera import Camera
from contid_camera.setup_file import LoadedSetup, TrackSetup
from contid_camera.tags import SeenTag
from contid_camera.tracker import AVERAGED, MOVED_IMAGES, TipTracker

CAMERA = Camera(size_px=(640, 480), focal_px=(700.0, 700.0), center_px=(320.0, 240.0))
SETUP = TrackSetup.model_validate(
    {
        "contid_track": 1,
        "camera": "camera.yaml",
        "world": [{"id": 0, "size_mm": 60.0, "x_mm": -60.0}, {"id": 1, "size_mm": 60.0, "x_mm": 60.0}],
        "tip": [{"id": 2, "size_mm": 20.0}],
    }
)
#: World to camera: the camera looks down on the tags.
DOWN = np.diag([1.0, -1.0, -1.0])


def seen(places: dict[int, Array], at_m: tuple[float, float, float]) -> dict[int, SeenTag]:
    """The fixed tags by a camera above a place."""
    found = {}
    for tag, corners in places.items():
        x, y, z = (corners @ DOWN.T + np.array(at_m)).T
        pixels = np.stack([700.0 * x / z + 320.0, 700.0 * y / z + 240.0], axis=1)
        found[tag] = SeenTag(pixels, pixels)
    return found


def test_a_tag_that_was_hidden_meanwhile_does_not_pull_at_the_world() -> None:
    tracker = TipTracker(LoadedSetup(SETUP, CAMERA))
    places = {tag.id: tag.corners_m for tag in SETUP.world}
    for _ in range(20):
        tracker._average(seen(places, (0.0, 0.0, 0.5)))
    moved = (0.03, 0.02, 0.5)
    for _ in range(MOVED_IMAGES + 20):
        last = tracker._average(seen({0: places[0]}, moved))
    assert last is None
    assert tracker._world_pose is not None
    assert tracker._world_pose.origin_m == pytest.approx(moved, abs=1e-3)
    for _ in range(20):
        assert tracker._average(seen(places, moved)) is None
    assert tracker._world_pose.origin_m == pytest.approx(moved, abs=1e-3)


@pytest.mark.parametrize("tag", [0, 1])
def test_a_fixed_tag_that_moved_is_named_whatever_its_number(tag: int) -> None:
    """The number 0 was taken for no tag: tips went out in a world that had moved."""
    tracker = TipTracker(LoadedSetup(SETUP, CAMERA))
    places = {each.id: each.corners_m for each in SETUP.world}
    images = [seen(places, (0.0, 0.0, 0.5)) for _ in range(3)]
    corners = images[-1][tag].ideal_px + 5.0
    images[-1][tag] = SeenTag(corners, corners)
    tracker._detector = SimpleNamespace(find=lambda number: images[number])  # type: ignore[assignment]
    refusals = [tracker.look(np.array(number), 0.1 * number).refusal for number in range(3)]
    assert refusals == ["no tag of the tip is seen"] * 2 + [f"tag {tag} or the camera has moved"]


def test_a_camera_that_creeps_takes_the_world_along() -> None:
    """Too slowly for a tag to count as moved: the average followed it, the pose did not."""
    tracker = TipTracker(LoadedSetup(SETUP, CAMERA))
    places = {tag.id: tag.corners_m for tag in SETUP.world}
    at_m = (0.0, 0.0, 0.5)
    for number in range(3 * AVERAGED):
        at_m = (max(number - AVERAGED, 0) * 5e-6, 0.0, 0.5)
        assert tracker._average(seen(places, at_m)) is None
    assert at_m[0] == pytest.approx(0.002, abs=1e-4)
    assert tracker._world_pose is not None
    # An average over 200 images is as much behind as the camera moves in them.
    assert tracker._world_pose.origin_m == pytest.approx(at_m, abs=0.0012)
    for _ in range(5 * AVERAGED):
        tracker._average(seen(places, at_m))
    assert tracker._world_pose.origin_m == pytest.approx(at_m, abs=1e-4)
