"""Inverse kinematics by distal supervised learning: the "neural network" of Singh et al.'s Table I.

Two networks: a forward one learns lengths to tip from data; an inverse one learns tip to lengths *through*
the frozen forward one, ``min |F(G(x)) - x|^2 + 1e-4 |G(x)|^2``. The tip error resolves the redundancy, which
an average over examples of lengths cannot. Training data are simulated: every combination of a few pressures,
mapped to lengths and tips by the model, with noise for the vision system. The real arm's hysteresis is
missing, so the errors are smaller than the paper's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from contid.errors import ContidError
from contid.kinematics.array import Array
from studies.arc_chains import forward
from studies.network import Network
from studies.singh import LOWER_M, UPPER_M, cbha_sections, lengths_at

#: Takes (what is trained, iterations done, validation error in mm).
Report: TypeAlias = Callable[[str, int, float], None]

#: Indices of samples.
Rows: TypeAlias = NDArray[np.int64]

_OUTPUT_PENALTY: Final = 1e-4
_KEYS: Final = ("parameters", "hidden", "centre_m", "scale_m", "trained_mm")


class NetworkFileError(ContidError):
    """A file is not a network saved by contid."""


@dataclass(frozen=True, slots=True)
class InverseNetwork:
    """A trained inverse network: tips [m] to tube lengths [m], always inside the tubes' limits.

    Attributes:
        network: the network in normalised units.
        centre_m, scale_m: what normalises tips [m].
        trained_mm: mean tip error on the test set at the end of training [mm].
    """

    network: Network
    centre_m: Array
    scale_m: Array
    trained_mm: float

    def lengths(self, tips_m: Array) -> Array:
        """Lengths ``(..., 6)`` [m] for tips ``(..., 3)`` [m]."""
        flat = (np.reshape(tips_m, (-1, 3)) - self.centre_m) / self.scale_m
        found = _lengths(self.network(flat))
        return found.reshape(*np.shape(tips_m)[:-1], 6)

    def save(self, path: Path) -> None:
        """Write an ``.npz`` that `load` reads."""
        with path.open("wb") as stream:
            np.savez(
                stream,
                parameters=self.network.parameters,
                hidden=self.network.hidden,
                centre_m=self.centre_m,
                scale_m=self.scale_m,
                trained_mm=self.trained_mm,
            )

    @classmethod
    def load(cls, path: Path) -> InverseNetwork:
        """Read a saved network.

        Raises:
            NetworkFileError: not such a file, or not a whole one; the message lists the missing keys.
        """
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                missing = [key for key in _KEYS if key not in stored]
                if missing:
                    what = ", ".join(missing)
                    raise NetworkFileError(f"{path}: no network saved by contid, {what} missing")
                parameters, hidden, centre, scale, trained = (stored[key] for key in _KEYS)
            found = cls(Network(3, int(hidden), 6, True, parameters), centre, scale, float(trained))
            found.lengths(centre)  # sizes that do not fit each other
        # What NumPy raises for a file that is cut off, empty, or one array.
        except (OSError, ValueError, EOFError, TypeError, BadZipFile) as error:
            raise NetworkFileError(f"{path}: no network saved by contid ({error})") from error
        return found


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to train.

    Attributes:
        hidden: neurons of each network.
        levels: pressures per tube; ``levels^6`` samples.
        noise_m: standard deviation of the measured tip, per axis [m].
        iterations: maximum number of L-BFGS iterations of each network.
        seed: of weights, noise and the split into 70 % training, 15 % validation and 15 % test.
    """

    hidden: int = 30
    levels: int = 4
    noise_m: float = 1e-3
    iterations: int = 1500
    seed: int = 1


def train(recipe: Recipe, report: Report = lambda what, iteration, error_mm: None) -> InverseNetwork:
    """Train forward and inverse network; the parameters with the least validation error are kept."""
    rng = np.random.default_rng(recipe.seed)
    grid = np.linspace(0.0, 1.5, recipe.levels)
    pressures = np.stack(np.meshgrid(*(grid,) * 6, indexing="ij"), axis=-1).reshape(-1, 6)
    lengths = lengths_at(pressures)
    tips = forward(cbha_sections(), lengths).tip + rng.normal(0.0, recipe.noise_m, (len(lengths), 3))
    order: Rows = rng.permutation(len(lengths)).astype(np.int64)
    first, second = int(0.70 * len(order)), int(0.85 * len(order))
    fit, check, test = order[:first], order[first:second], order[second:]
    centre, scale = tips[fit].mean(axis=0), tips[fit].std(axis=0)
    outputs, targets = _normalised(lengths), (tips - centre) / scale

    def forward_loss(net: Network, rows: Rows) -> tuple[float, Array]:
        y, back = net.with_gradient(outputs[rows])
        error = (y - targets[rows]) * scale
        return float((error**2).sum() / len(rows)), back(2.0 * error * scale / len(rows))[0]

    model = Network.random(6, recipe.hidden, 3, False, rng)
    model = _minimise(model, forward_loss, fit, check, recipe.iterations, "forward network", report)

    def inverse_loss(net: Network, rows: Rows) -> tuple[float, Array]:
        out, back = net.with_gradient(targets[rows])
        y, back_model = model.with_gradient(out)
        error = (y - targets[rows]) * scale
        by_out = back_model(2.0 * error * scale / len(rows))[1]
        penalty = _OUTPUT_PENALTY * float(scale.mean()) ** 2
        loss = float(((error**2).sum() + penalty * (out**2).sum()) / len(rows))
        return loss, back(by_out + 2.0 * penalty * out / len(rows))[0]

    inverse = Network.random(3, recipe.hidden, 6, True, rng)
    inverse = _minimise(inverse, inverse_loss, fit, check, recipe.iterations, "inverse network", report)
    reached = forward(cbha_sections(), _lengths(inverse(targets[test]))).tip
    error_mm = 1e3 * float(np.linalg.norm(reached - tips[test], axis=-1).mean())
    return InverseNetwork(inverse, centre, scale, error_mm)


def _minimise(
    network: Network,
    loss: Callable[[Network, Rows], tuple[float, Array]],
    fit: Rows,
    check: Rows,
    iterations: int,
    what: str,
    report: Report,
) -> Network:
    """Full-batch L-BFGS; returns the parameters that were best on the validation rows."""
    from scipy import optimize  # hundreds of milliseconds; only training needs it

    kept = network.parameters
    least, done, unit = np.inf, 0, 1e6  # losses in mm^2: the tolerances of L-BFGS are made for such numbers

    def objective(parameters: Array) -> tuple[float, Array]:
        value, gradient = loss(network.at(parameters), fit)
        return unit * value, unit * gradient

    def keep(parameters: Array) -> None:
        nonlocal kept, least, done
        done += 1
        value = loss(network.at(parameters), check)[0]
        if value < least:
            kept, least = parameters.copy(), value
        report(what, done, 1e3 * float(np.sqrt(value)))

    minimise: Callable[..., object] = optimize.minimize
    minimise(
        objective,
        network.parameters,
        jac=True,
        method="L-BFGS-B",
        callback=keep,
        options={"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 20, "ftol": 1e-12, "gtol": 1e-8},
    )
    return network.at(kept)


def _normalised(lengths_m: Array) -> Array:
    low, high = np.array(LOWER_M), np.array(UPPER_M)
    scaled: Array = 2.0 * (lengths_m - low) / (high - low) - 1.0
    return scaled


def _lengths(normalised: Array) -> Array:
    low, high = np.array(LOWER_M), np.array(UPPER_M)
    lengths: Array = low + 0.5 * (high - low) * (normalised + 1.0)
    return lengths
