"""``contid track`` and ``contid calibrate camera`` as processes, on rendered videos and images."""

import csv
import io
import signal
import subprocess
import sys

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from tests.support.camera_render import Lens, Studio, chessboard
from tests.support.camera_scene import TIP, WORLD, Scene, motion, places, setup

pytestmark = pytest.mark.process

FPS = 25.0


def contid(*arguments, cwd):
    command = [sys.executable, "-m", "contid", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=cwd)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A video of a moving tip, its camera and its setup."""
    path = tmp_path_factory.mktemp("track")
    scene, rng = Scene.usual(), np.random.default_rng(1)
    video = cv2.VideoWriter(str(path / "tip.avi"), cv2.VideoWriter.fourcc(*"FFV1"), FPS, (640, 480))
    assert video.isOpened()
    for k in range(20):
        tip, rotation = motion(k / FPS)
        hidden = (10, 11, 12) if k in (10, 11) else ()
        video.write(cv2.cvtColor(scene.image(tip, rotation, rng, hidden=hidden), cv2.COLOR_GRAY2BGR))
    video.release()
    (path / "camera.yaml").write_text(setup().camera.text())
    contents = {"contid_track": 1, "camera": "camera.yaml", "world": places(WORLD), "tip": places(TIP)}
    (path / "track.yaml").write_text(yaml.safe_dump(contents))
    return path


def test_a_video_becomes_rows_near_the_truth_and_an_overlay(folder):
    done = contid("track", "--camera", "tip.avi", "--print", "--overlay", "seen.png", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert len(rows) == 18
    assert "18 of 20 images measured" in done.stderr
    assert "2 not: no tag of the tip is seen" in done.stderr
    off = []
    for row in rows:
        tip, rotation = motion(float(row["t_s"]))
        off.append(np.linalg.norm([float(row[f"{axis}_mm"]) - 1e3 * tip[k] for k, axis in enumerate("xyz")]))
        direction = [float(row[axis]) for axis in ("ax", "ay", "az")]
        assert np.degrees(np.arccos(min(1.0, float(np.dot(direction, rotation[:, 2]))))) < 1.0
    assert np.sqrt(np.mean(np.square(off))) <= 0.3
    overlay = cv2.imread(str(folder / "seen.png"))
    assert overlay is not None
    assert overlay.shape == (480, 640, 3)


def test_ctrl_c_ends_with_a_report(folder, tmp_path):
    """Images of a camera have no other end."""
    capture = cv2.VideoCapture(str(folder / "tip.avi"))
    got, image = capture.read()
    assert got
    capture.release()
    (tmp_path / "images").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "0000.png"), image)
    for number in range(1, 5000):
        (tmp_path / "images" / f"{number:04}.png").symlink_to("0000.png")
    command = [sys.executable, "-m", "contid", "track", "--camera", str(tmp_path / "images"), "--print"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=folder) as process:
        assert process.stdout is not None
        for _ in range(3):
            assert process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "images measured" in errors


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("id: 10", "id: 11", "twice: 11"),
        ("size_mm: 22.0", "size_m: 22.0", "unknown key 'size_m'"),
        ("camera: camera.yaml", "camera: cam.yaml", "cam.yaml: cannot read it: No such file"),
        ("contid_track: 1", "contid_track: 2", "contid_track"),
        ("id: 0", "id: 587", "id"),
    ],
)
def test_mistakes_in_the_setup_have_their_place(folder, tmp_path, old, new, expected):
    text = (folder / "track.yaml").read_text()
    assert old in text
    (tmp_path / "track.yaml").write_text(text.replace(old, new, 1))
    (tmp_path / "camera.yaml").write_text((folder / "camera.yaml").read_text())
    done = contid("track", "--camera", str(folder / "tip.avi"), "--print", cwd=tmp_path)
    assert done.returncode == 2
    assert expected in done.stderr
    assert "Traceback" not in done.stderr


def test_images_that_cannot_be_had_are_named(folder, tmp_path):
    missing = contid("track", "--camera", "none.avi", "--print", cwd=folder)
    assert missing.returncode == 2
    assert "none.avi: no such video, and not the number of a camera" in missing.stderr
    (tmp_path / "text.avi").write_text("no video")
    unreadable = contid("track", "--camera", str(tmp_path / "text.avi"), "--print", cwd=folder)
    assert unreadable.returncode == 2
    assert "not a video that OpenCV can read" in unreadable.stderr
    other = (folder / "camera.yaml").read_text().replace("[640, 480]", "[1280, 720]")
    (tmp_path / "camera.yaml").write_text(other)
    (tmp_path / "track.yaml").write_text((folder / "track.yaml").read_text())
    size = contid("track", "--camera", str(folder / "tip.avi"), "--print", cwd=tmp_path)
    assert size.returncode == 2
    assert "images of 640 x 480 pixels; the camera was calibrated with 1280 x 720" in size.stderr
    joined = contid("track", "--camera=1e", "--print", cwd=folder)
    assert joined.returncode == 2
    assert "1e: no such video" in joined.stderr
    near = contid("track", "vicon1", "--camera=none.avi", "--print", cwd=folder)
    assert "none.avi: no such video" in near.stderr
    nowhere = contid("track", "--print", cwd=folder)
    assert nowhere.returncode == 2
    assert "--camera" in nowhere.stderr


def test_tags_to_print_are_found_by_another_image(folder, tmp_path):
    done = contid("track", "--tags", str(tmp_path / "tags"), cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "tag10.png: print 27.5 mm wide, its black square is then 22 mm" in done.stdout
    for number in (*WORLD, *TIP):
        image = cv2.imread(str(tmp_path / "tags" / f"tag{number}.png"), cv2.IMREAD_GRAYSCALE)
        assert image is not None
        sheet = np.pad(image, 60, constant_values=255)
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        _, ids, _ = cv2.aruco.ArucoDetector(family).detectMarkers(sheet)
        assert np.ravel(ids).tolist() == [number]
        black = np.flatnonzero(image[image.shape[0] // 2] < 128)
        assert (black[-1] - black[0] + 1) / image.shape[1] == pytest.approx(0.8, abs=0.01)


def test_a_folder_of_images_calibrates(tmp_path):
    rng, lens = np.random.default_rng(2), Lens()
    studio = Studio(lens)
    (tmp_path / "boards").mkdir()
    for k in range(9):
        angles = [180.0 + rng.uniform(-35, 35), rng.uniform(-35, 35), rng.uniform(-20, 20)]
        turn = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        at = [0.05 * ((k % 3) - 1), 0.035 * ((k // 3) % 3 - 1), rng.uniform(0.28, 0.36)]
        image = studio.image([chessboard(9, 6, 0.016, turn, at)], rng)
        cv2.imwrite(str(tmp_path / "boards" / f"{k:02}.png"), image)
    arguments = ["calibrate", "camera", "boards", "--board", "9x6", "--square-mm", "16", "-o", "camera.yaml"]
    done = contid(*arguments, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    written = yaml.safe_load((tmp_path / "camera.yaml").read_text())
    assert written["focal_px"] == pytest.approx(lens.focal, rel=0.01)
    assert written["center_px"] == pytest.approx(lens.center, abs=5.0)
    # A board that is not there is looked for in every way.
    for path in sorted((tmp_path / "boards").iterdir())[1:]:
        path.unlink()
    wrong = contid(*arguments[:4], "7x7", *arguments[5:], cwd=tmp_path)
    assert wrong.returncode == 2
    assert "a board of 7 x 7 inner corners was found in 0 images that differ, of 1" in wrong.stderr
