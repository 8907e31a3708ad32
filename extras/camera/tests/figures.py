"""The figures of docs/devices/camera.md: python -m extras.camera.tests.figures [IMAGES]."""

import sys
import time

import cv2
import numpy as np

from contid_camera.jumps import turn_rad
from contid_camera.tracker import TipTracker
from tests.support.camera_scene import TIP, WORLD, Scene, motion, setup


def main(images):
    """One line for each light."""
    cv2.setNumThreads(1)
    for light, noise, blur_px in ((1.0, 2.5, 0.8), (0.35, 3.0, 1.1)):
        scene, tracker, rng = (
            Scene.usual(noise=noise, blur_px=blur_px),
            TipTracker(setup()),
            np.random.default_rng(1),
        )
        off, turned, work_s = [], [], 0.0
        for k in range(images):
            tip, rotation = motion(k / 30.0)
            hidden = ()
            if rng.random() < 0.3:
                hidden = rng.choice([*WORLD, *TIP], rng.integers(1, 4), replace=False).tolist()
            image = scene.image(tip, rotation, rng, light, hidden)
            begin_s = time.process_time()
            look = tracker.look(image, k / 30.0)
            work_s += time.process_time() - begin_s
            if look.tip is not None:
                off.append(1e3 * np.linalg.norm(np.array(look.tip.tip_m) - tip))
                turned.append(np.degrees(turn_rad(look.tip.rotation, rotation)))
        rms = [np.sqrt(np.mean(np.square(each))) for each in (off, turned)]
        print(
            f"light {light:g}, noise {noise:g} of 255, blur {blur_px:g} px: {len(off)} of {images} taken, "
            f"tip {rms[0]:.3f} mm rms, {max(off):.2f} worst, {sum(each > 1.0 for each in off)} above 1 mm; "
            f"{rms[1]:.3f} deg rms, {max(turned):.2f} worst; {images / work_s:.0f} images/s"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 300)
