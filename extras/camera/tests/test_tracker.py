"""Rendered images with known truth: accuracy, hidden tags, flips, jumps, a camera that moves."""

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contid.errors import ContidError
from contid_camera.board import calibrated
from contid_camera.body_pose import alike, solve_pose
from contid_camera.jumps import turn_rad
from contid_camera.overlay import drawn
from contid_camera.setup_file import CORNERS
from contid_camera.tracker import TipTracker
from tests.support.camera_render import Lens, Studio, chessboard
from tests.support.camera_scene import TIP, WORLD, Scene, motion, setup

pytestmark = pytest.mark.slow

TAGS = [*WORLD, *TIP]


def tracked(tracker, scene, seconds, rng, light=1.0, hide=0.3):
    """Errors [mm, deg] of the tips that were taken, and the looks."""
    errors, looks = [], []
    for t in np.arange(0.0, seconds, 0.1):
        hidden = rng.choice(TAGS, rng.integers(1, 4), replace=False).tolist() if rng.random() < hide else ()
        tip, rotation = motion(t)
        look = tracker.look(scene.image(tip, rotation, rng, light, hidden), float(t))
        looks.append(look)
        if look.tip is not None:
            off_mm = 1e3 * np.linalg.norm(np.array(look.tip.tip_m) - tip)
            errors.append((off_mm, np.degrees(turn_rad(look.tip.rotation, rotation))))
            assert look.tip.direction == pytest.approx(look.tip.rotation[:, 2])
    return np.array(errors), looks


@pytest.mark.parametrize("seconds", [1.5, pytest.param(3.0, marks=pytest.mark.campaign)])
@pytest.mark.parametrize(
    ("light", "noise", "blur_px"),
    [pytest.param(1.0, 2.5, 0.8, marks=pytest.mark.campaign), (0.35, 3.0, 1.1)],
)
def test_the_tip_is_measured_in_two_lights_while_tags_are_hidden_now_and_then(light, noise, blur_px, seconds):
    rng, scene = np.random.default_rng(1), Scene.usual(noise=noise, blur_px=blur_px)
    errors, looks = tracked(TipTracker(setup()), scene, seconds, rng, light)
    assert len(errors) > 0.8 * len(looks)
    mm, degrees = np.sqrt(np.mean(errors**2, axis=0))
    assert mm <= 0.3
    assert degrees <= 0.3
    assert errors[:, 0].max() <= 1.0
    # The stated deviation is neither far too small nor far too great.
    off = [e[0] for e in errors]
    stated = [1e3 * look.tip.tip_sd_m for look in looks if look.tip is not None]
    assert 0.2 < np.median(np.array(off) / np.array(stated)) < 2.0


@pytest.mark.campaign
def test_a_calibrated_camera_measures_as_the_true_one():
    """The board is rendered with the distortion of the lens; nothing of it is given to the calibration."""
    rng, lens = np.random.default_rng(2), Lens()
    studio = Studio(lens, blur_px=0.7, noise=2.0)
    images = []
    for k in range(16):
        angles = [180.0 + rng.uniform(-35, 35), rng.uniform(-35, 35), rng.uniform(-20, 20)]
        turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        at = [0.05 * ((k % 3) - 1), 0.035 * ((k // 3) % 3 - 1), rng.uniform(0.28, 0.36)]
        images.append(studio.image([chessboard(9, 6, 0.016, turn, at)], rng))
    camera, used, cover = calibrated(images, 9, 6, 0.016)
    assert used >= 15
    assert cover > 0.7
    assert camera.error_px is not None
    assert camera.error_px < 0.15
    # Where both cameras see the same points, in the middle and near the edges.
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.28, 0.28, 7)), axis=-1).reshape(
        -1, 2
    )
    rays = np.column_stack([grid, np.ones(len(grid))])
    seen = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, camera.coefficients)[0].reshape(
        -1, 2
    )
    assert np.linalg.norm(seen - lens.pixels(rays), axis=1).mean() < 1.0
    found = Lens(lens.size, camera.focal_px, camera.center_px, camera.distortion)
    errors, looks = tracked(TipTracker(setup(found)), Scene.usual(), 1.0, rng, hide=0.0)
    assert len(errors) == len(looks)
    assert np.sqrt(np.mean(errors[:, 0] ** 2)) <= 0.3
    assert np.sqrt(np.mean(errors[:, 1] ** 2)) <= 0.3


def test_images_without_a_board_do_not_calibrate():
    grey: Any = np.full((480, 640), 128, np.uint8)
    with pytest.raises(ContidError, match="found in 0 images that differ, of 2"):
        calibrated([grey] * 2, 9, 6, 0.016)


def square(rotation, center, noise_px, rng):
    """Ideal pixels of a 20 mm square, by arithmetic of its own."""
    points = CORNERS * 0.02 @ rotation.T + center
    return points[:, :2] / points[:, 2:] * 700.0 + [320.0, 240.0] + rng.normal(0.0, noise_px, (4, 2))


def test_a_flipped_square_has_its_other_pose_as_a_warning():
    """Far away and nearly frontal, a square and its mirror image are within the noise."""
    rng, matrix = np.random.default_rng(3), np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]])
    flipped = warned = 0
    for _ in range(100):
        tilt = Rotation.from_euler(
            "xyz", [180.0 + rng.uniform(-25, 25), rng.uniform(-25, 25), 0], degrees=True
        )
        seen = square(tilt.as_matrix(), np.array([0.0, 0.0, 0.7]), 0.15, rng)
        pose = solve_pose({5: CORNERS * 0.02}, {5: seen}, matrix)
        assert pose is not None
        if turn_rad(pose.rotation, tilt.as_matrix()) > np.radians(12.0):
            flipped += 1
            warned += alike(pose, pose.other)
        near = solve_pose({5: CORNERS * 0.02}, {5: seen}, matrix, tilt.as_matrix())
        assert near is not None
        assert turn_rad(near.rotation, tilt.as_matrix()) < np.radians(20.0)
    assert flipped > 5
    assert warned == flipped, (warned, flipped)


def test_a_jump_is_refused_until_it_lasts():
    scene, rng, tracker = Scene.usual(), np.random.default_rng(4), TipTracker(setup(lost=5))
    tip, rotation = motion(0.0)
    for k in range(3):
        assert tracker.look(scene.image(tip, rotation, rng), 0.03 * k).tip is not None
    away = tip + np.array([0.02, 0.0, 0.0])
    looks = [tracker.look(scene.image(away, rotation, rng), 0.09 + 0.001 * k) for k in range(6)]
    assert [look.tip is None for look in looks] == [True] * 4 + [False] * 2
    assert looks[0].refusal == "the tip jumps by 20.0 mm"


def test_a_camera_that_moves_is_noticed_and_followed():
    scene, rng, tracker = Scene.usual(), np.random.default_rng(5), TipTracker(setup())
    tip, rotation = motion(0.5)
    for k in range(5):
        assert tracker.look(scene.image(tip, rotation, rng), 0.03 * k).tip is not None
    scene.origin = scene.origin + np.array([0.01, 0.0, 0.0])
    looks = [tracker.look(scene.image(tip, rotation, rng), 0.2 + 0.03 * k) for k in range(12)]
    assert "or the camera has moved" in looks[0].refusal
    assert looks[0].tip is None
    assert looks[-1].tip is not None
    assert 1e3 * np.linalg.norm(np.array(looks[-1].tip.tip_m) - tip) < 0.3


def test_the_overlay_marks_tags_and_names_why_there_is_no_tip():
    scene, rng = Scene.usual(), np.random.default_rng(6)
    tip, rotation = motion(0.0)
    loaded = setup()
    for hidden, colour in (((), (80, 220, 80)), ((10, 11, 12), (60, 60, 240))):
        image = scene.image(tip, rotation, rng, hidden=hidden)
        look = TipTracker(loaded).look(image, 0.0)
        canvas = drawn(image, look, loaded.camera)
        assert canvas.shape == (480, 640, 3)
        corner = np.round(look.seen[0].corners_px[0]).astype(int)
        near = canvas[corner[1] - 2 : corner[1] + 3, corner[0] - 2 : corner[0] + 3].reshape(-1, 3)
        assert np.abs(near.astype(int) - colour).sum(axis=1).min() < 90
        assert bool(look.refusal) == bool(hidden)
