"""Tip errors of static models of a real trunk with six motors and twelve tendons, from its motor angles.

    python -m studies.moving.trunk_statics FOLDER [--held-out FILE]

FOLDER holds ``trunk-dynamic/random_a_0g.csv.gz``: 150 s of StanfordASL/trunk-stack at commit 8b4b923 (MIT,
(c) 2024 Stanford Autonomous Systems Lab), repacked. The split: models are fitted to the first 60 % of the
recording and predict the last 35 %, 7.5 s later. With ``--held-out`` they are fitted to the whole recording
and predict another one. Penalties are chosen by folds inside the fitted rows; each model predicts the rows
kept out once.

Statics: bends follow from the travels of the drives by `TendonStatics` (springs against the hose), sections
are arcs. Fitted are a gain and a stiffness per section, an azimuth per motor, lengths, the bends at rest and
the frame of the cameras: 27 numbers, to all three discs. The residual is a polynomial of third degree of the
bends. Nothing depends on velocities, or on what was before. Angles are interpolated between their updates.
"""

from __future__ import annotations

import gzip
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Final

import click
import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from contid.kinematics.array import Array
from contid.kinematics.tendon.geometry import TendonGeometry, TendonSection, forward
from contid.kinematics.tendon.tension import TendonStatics
from contid.units import MM_PER_M
from contid_tendons.driven import DriveMap

#: The two motors of every section, from the base on, and azimuths to begin with [deg].
MOTORS: Final = ((2, 4), (0, 5), (1, 3))
AZIMUTHS_DEG: Final = (-46.0, -111.0, 186.0, 154.0, 99.0, 52.0)
FITTED: Final = 0.6
GAP: Final = 0.05
#: Single frames jump: a median over this number of rows.
FRAMES: Final = 9
#: One row of this number is fitted; 10 ms apart they have little that is new.
STRIDE: Final = 25
FOLDS: Final = 5
PENALTIES: Final = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
#: Weights of the discs: the tip is what is asked.
WEIGHTS: Final = np.array([0.6, 0.6, 1.0])
#: Tendons are as stiff as this, and as far from the backbone; only ratios matter [N/m, m].
STIFFNESS: Final = 1000.0
ARM_M: Final = 0.025


@dataclass(frozen=True, eq=False)
class Recording:
    """Angles of six motors ``(n, 6)`` [rad] and places of three discs ``(n, 3, 3)`` [m]."""

    angles: Array
    discs_m: Array

    def __getitem__(self, rows: slice) -> Recording:
        return Recording(self.angles[rows], self.discs_m[rows])


def read(path: Path) -> Recording:
    """A recording of the trunk."""
    with gzip.open(path, "rt", encoding="utf-8") as lines:
        table = np.genfromtxt(lines, delimiter=",", names=True)
    degrees = np.stack([table[f"phi{k}_deg"] for k in range(1, 7)], axis=1)
    ticks = np.arange(len(table))
    fresh = np.flatnonzero(np.r_[True, np.any(np.diff(degrees, axis=0) != 0.0, axis=1)])
    angles = np.stack([np.interp(ticks, fresh, np.radians(column[fresh])) for column in degrees.T], axis=1)
    discs = np.stack([[table[f"{axis}{k}_mm"] for axis in "xyz"] for k in (1, 2, 3)]).transpose(2, 0, 1)
    return Recording(angles, median_filter(discs, size=(FRAMES, 1, 1)) / MM_PER_M)


@dataclass(frozen=True, eq=False)
class Trunk:
    """The statics as 27 numbers.

    Attributes:
        gain: travel of the drives of a section per angle [arms/rad], shape ``(3,)``.
        stiffness: log of the stiffness of each section by that of its tendons.
        azimuth: of the tendon that each motor winds in [rad], shape ``(6,)``.
        rest: bends without travel [rad], shape ``(6,)``.
        length_m: of the sections, shape ``(3,)``.
        turn, base_m: the base in the frame of the cameras: rotation vector and place.
    """

    gain: Array
    stiffness: Array
    azimuth: Array
    rest: Array
    length_m: Array
    turn: Array
    base_m: Array

    @classmethod
    def of(cls, numbers: Array) -> Trunk:
        """From the numbers of a fit."""
        return cls(*np.split(numbers, (3, 6, 12, 18, 21, 24)))

    @property
    def geometry(self) -> TendonGeometry:
        """Sections of four tendons: for each motor what it winds in, then what it pays out."""
        sections = []
        for length_m, pair in zip(self.length_m.tolist(), MOTORS, strict=True):
            azimuths = tuple(float(self.azimuth[motor] + half) for motor in pair for half in (0.0, np.pi))
            sections.append(TendonSection(length_m, (ARM_M,) * 4, azimuths))
        return TendonGeometry(tuple(sections))

    def bends(self, angles: Array) -> Array:
        """Bends ``(n, 6)`` [rad] of motor angles ``(n, 6)`` [rad]."""
        bending = tuple((STIFFNESS * ARM_M**2 * np.exp(self.stiffness)).tolist())
        statics = TendonStatics(self.geometry, bending, np.full(12, STIFFNESS), 1.0, 1e3)
        drives = np.zeros((12, 6))
        for section, pair in enumerate(MOTORS):
            for number, motor in enumerate(pair):
                first = 4 * section + 2 * number
                drives[first : first + 2, motor] = ARM_M * self.gain[section] * np.array([1.0, -1.0])
        bends: Array = angles @ DriveMap.of(statics.bends_by_pulls, drives).bends_by_drives.T + self.rest
        return bends

    def discs_m(self, angles: Array) -> Array:
        """Discs ``(n, 3, 3)`` [m] in the frame of the cameras."""
        turned = Rotation.from_rotvec(self.turn).as_matrix()
        discs: Array = forward(self.geometry, self.bends(angles)).discs_m @ turned.T + self.base_m
        return discs


def start() -> Array:
    """What a fit begins with: the trunk hangs along -y of the cameras below a point near their recordings."""
    return np.concatenate((
        np.full(3, 0.9), np.full(3, -0.7), np.radians(AZIMUTHS_DEG), np.zeros(6), np.full(3, 0.106),
        [0.5 * np.pi, 0.0, 0.0], [0.101, 0.0, 0.105],
    ))  # fmt: skip


def fit_trunk(data: Recording) -> Trunk:
    """The numbers that predict the discs best, near those of `start` where the data leave a choice."""
    rows, begin = data[slice(None, None, STRIDE)], start()
    spread = np.repeat((np.inf, 0.2, 0.005, 0.1, 0.01), (12, 6, 3, 3, 3))

    def residuals(numbers: Array) -> Array:
        error = (Trunk.of(numbers).discs_m(rows.angles) - rows.discs_m) * WEIGHTS[:, None]
        return np.concatenate((MM_PER_M * error.ravel(), 10.0 * (numbers - begin) / spread))

    scale = np.repeat((0.3, 1.0, 0.2, 0.02, 0.2, 0.03), (3, 3, 12, 3, 3, 3))
    return Trunk.of(least_squares(residuals, begin, x_scale=scale, max_nfev=40).x)


def cubic(values: Array) -> Array:
    """Products of up to three columns, shape ``(n, 83)`` for six.

    Columns have a spread of a half, so that a penalty weighs on higher degrees more.
    """
    columns = range(values.shape[1])
    sets = (c for degree in (1, 2, 3) for c in combinations_with_replacement(columns, degree))
    return np.stack([np.prod(values[:, list(each)], axis=1) for each in sets], axis=1)


def ridge(features: Array, values: Array, penalty: float) -> Callable[[Array], Array]:
    """Linear regression with a penalty on its gains."""
    mean = values.mean(axis=0)
    normal = features.T @ features + penalty * np.eye(features.shape[1])
    gains = np.linalg.solve(normal, features.T @ (values - mean))
    return lambda other: other @ gains + mean


def fit_ridge(features: Array, values: Array) -> Callable[[Array], Array]:
    """The same with the penalty that predicts left-out fifths of the rows best."""
    blocks = np.array_split(np.arange(len(values)), FOLDS)

    def left_out(penalty: float) -> float:
        found = 0.0
        for block in blocks:
            kept = np.setdiff1d(np.arange(len(values)), block)
            predicted = ridge(features[kept], values[kept], penalty)(features[block])
            found += float(((predicted - values[block]) ** 2).sum())
        return found

    return ridge(features, values, min(PENALTIES, key=left_out))


def predictions(fitted: Recording, other: Recording) -> Iterator[tuple[str, Array]]:
    """Names of models and the tips that they predict of the other recording ``(n, 3)`` [m]."""
    sparse = fitted[slice(None, None, 5)]
    tips, scale = sparse.discs_m[:, 2], 2.0 * sparse.angles.std(axis=0)
    yield "linear in the angles", fit_ridge(sparse.angles / scale, tips)(other.angles / scale)
    yield "cubic in the angles", fit_ridge(cubic(sparse.angles / scale), tips)(cubic(other.angles / scale))
    trunk = fit_trunk(fitted)
    arcs = trunk.discs_m(other.angles)[:, 2]
    yield "arcs by statics", arcs
    bends, others = trunk.bends(sparse.angles), trunk.bends(other.angles)
    left, spread = tips - trunk.discs_m(sparse.angles)[:, 2], 2.0 * bends.std(axis=0)
    residual = fit_ridge(cubic(bends / spread), left)
    yield "arcs by statics, residual cubic in the bends", arcs + residual(cubic(others / spread))
    click.echo(
        f"gains {np.round(trunk.gain, 3)}, stiffness by tendons {np.round(np.exp(trunk.stiffness), 3)}"
    )
    azimuths = np.round(np.degrees(trunk.azimuth), 1)
    click.echo(f"azimuths [deg] {azimuths}, lengths [mm] {np.round(MM_PER_M * trunk.length_m, 1)}")


def split(data: Recording) -> tuple[Recording, Recording]:
    """The rows to fit and those kept out."""
    count = len(data.angles)
    return data[slice(0, int(FITTED * count))], data[slice(int((FITTED + GAP) * count), count)]


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--held-out", type=click.Path(exists=True, path_type=Path), help="another recording")
def main(folder: Path, held_out: Path | None) -> None:
    """Print the tip errors of every model on rows kept out."""
    data = read(folder / "trunk-dynamic" / "random_a_0g.csv.gz")
    fitted, other = split(data) if held_out is None else (data, read(held_out))
    click.echo(f"{len(fitted.angles)} rows fitted, {len(other.angles)} rows predicted; RMSE of the tip [mm]")
    for name, tips in predictions(fitted, other):
        rmse_m = float(np.sqrt(((tips - other.discs_m[:, 2]) ** 2).sum(axis=1).mean()))
        click.echo(f"{name:<46} {MM_PER_M * rmse_m:6.2f}")


if __name__ == "__main__":
    main()
