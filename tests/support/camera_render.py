"""Images of prints by a projection of their own: pinhole, distortion, blur, noise and light.

Every pixel is a grid of rays. A ray is found by inverting the distortion, meets the plane of a print, and
takes the grey value of the print there. Only the bits of the tags are OpenCV's.
"""

from dataclasses import dataclass, field
from functools import cache

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

#: Rays per side of a pixel.
RAYS = 4
#: Rows of rays that are inverted at a time: their arrays stay in the cache of the processor.
ROWS = 8
#: What a ray may miss its place by, in focal lengths: a thousandth of the pixels that a tag is found to.
INVERTED = 1e-7


@dataclass(frozen=True)
class Lens:
    """A camera: focal lengths, centre and k1, k2, p1, p2, k3."""

    size: tuple[int, int] = (640, 480)
    focal: tuple[float, float] = (702.0, 698.5)
    center: tuple[float, float] = (325.4, 236.2)
    distortion: tuple[float, ...] = (-0.18, 0.06, 0.0006, -0.0004, -0.01)

    def bent(self, x, y):
        """Where an ideal ray is seen, in focal lengths."""
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )

    def pixels(self, points):
        """Pixels of points in the camera ``(n, 3)``."""
        x, y = self.bent(points[:, 0] / points[:, 2], points[:, 1] / points[:, 2])
        return np.stack([x * self.focal[0] + self.center[0], y * self.focal[1] + self.center[1]], axis=1)

    @cache  # noqa: B019 -- a few lenses per run
    def rays(self):
        """Directions ``(2, height * RAYS, width * RAYS)`` of all rays, by fixed-point inversion."""
        width, height = self.size
        u = (np.arange(width * RAYS) + 0.5) / RAYS - 0.5
        v = (np.arange(height * RAYS) + 0.5) / RAYS - 0.5
        found = np.empty((2, len(v), len(u)))
        for row in range(0, len(v), ROWS):
            seen_x, seen_y = np.meshgrid(
                (u - self.center[0]) / self.focal[0], (v[row : row + ROWS] - self.center[1]) / self.focal[1]
            )
            x, y = seen_x, seen_y
            for _ in range(20):
                bent_x, bent_y = self.bent(x, y)
                off_x, off_y = seen_x - bent_x, seen_y - bent_y
                x, y = x + off_x, y + off_y
                if max(np.abs(off_x).max(), np.abs(off_y).max()) < INVERTED:
                    break
            found[:, row : row + ROWS] = x, y
        return found


@dataclass
class Print:
    """A flat print: grey values 0 to 1, its size [m], and its pose: rotation and centre in some frame."""

    grey: np.ndarray
    size: tuple[float, float]
    rotation: np.ndarray
    center: np.ndarray

    def moved(self, rotation, origin):
        """The same print in another frame."""
        return Print(self.grey, self.size, rotation @ self.rotation, rotation @ self.center + origin)


def tag(number, size_m, rotation, center):
    """A tag of the family 36h11 with a white border of an eighth."""
    bits = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), number, 8, borderBits=1
    )
    grey = np.pad(bits / 255.0, 1, constant_values=1.0)
    return Print(grey, (size_m * 10 / 8,) * 2, np.asarray(rotation, float), np.asarray(center, float))


def chessboard(columns, rows, square_m, rotation, center):
    """A board with ``columns x rows`` inner corners and a white border of a square."""
    squares = np.indices((rows + 1, columns + 1)).sum(axis=0) % 2
    grey = np.pad(squares.astype(float), 1, constant_values=1.0)
    return Print(grey, ((columns + 3) * square_m, (rows + 3) * square_m), rotation, np.asarray(center, float))


@dataclass
class Studio:
    """Renders prints as one camera sees them.

    Attributes:
        lens: of the camera.
        blur_px: standard deviation of the blur.
        noise: standard deviation of a grey value, of 255.
        background: grey value where there is no print.
    """

    lens: Lens = field(default_factory=Lens)
    blur_px: float = 0.7
    noise: float = 2.0
    background: float = 0.55

    def __post_init__(self):
        self._rays = self.lens.rays()

    def image(self, prints, rng, light=1.0):
        """Bytes ``(height, width)``; prints in the frame of the camera, near ones hide far ones."""
        width, height = self.lens.size
        grey = np.full((height, width), self.background)
        for each in sorted(prints, key=lambda p: -p.center[2]):
            self._draw(grey, each)
        blurred = gaussian_filter(grey, self.blur_px)
        seen = 255.0 * (0.04 + 0.86 * light * blurred) + rng.normal(0.0, self.noise, grey.shape)
        return np.clip(np.round(seen), 0, 255).astype(np.uint8)

    def _draw(self, grey, each):
        if each.rotation[:, 2] @ each.center > 0.0:
            return  # seen from behind
        half = 0.5 * np.array(each.size)
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        corners = each.center + (signs * half) @ each.rotation[:, :2].T
        if corners[:, 2].min() <= 0.01:
            return
        pixels = self.lens.pixels(corners)
        height, width = grey.shape
        u0, v0 = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
        u1, v1 = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + 3, [width, height])
        if u0 >= u1 or v0 >= v1:
            return
        x, y = self._rays[:, v0 * RAYS : v1 * RAYS, u0 * RAYS : u1 * RAYS]
        # Of each ray along the axes of the print, on the plane of the print: z is where it meets the plane.
        local_x, local_y, local_z = (x * a + (y * b + c) for a, b, c in each.rotation.T)
        from_x, from_y, from_z = each.center @ each.rotation
        depth = from_z / local_z
        rows, columns = each.grey.shape
        column = np.floor(((local_x * depth - from_x) / each.size[0] + 0.5) * columns).astype(int)
        row = np.floor((0.5 - (local_y * depth - from_y) / each.size[1]) * rows).astype(int)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        value = each.grey[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
        shape = (v1 - v0, RAYS, u1 - u0, RAYS)
        covered = inside.reshape(shape).mean(axis=(1, 3))
        painted = (value * inside).reshape(shape).mean(axis=(1, 3))
        area = grey[v0:v1, u0:u1]
        grey[v0:v1, u0:u1] = area * (1.0 - covered) + painted
