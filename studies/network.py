"""A network of one hidden layer, ``tanh`` inside, with its gradient: what distal learning takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from contid.kinematics.array import Array


@dataclass(frozen=True, slots=True)
class Network:
    """``y = W2 tanh(W1 x + b1) + b2``, with ``tanh`` around it when ``bounded``; rows are samples.

    Attributes:
        inputs, hidden, outputs: sizes.
        bounded: outputs stay inside (-1, 1).
        parameters: W1, b1, W2, b2 in one vector.
    """

    inputs: int
    hidden: int
    outputs: int
    bounded: bool
    parameters: Array

    @classmethod
    def random(
        cls, inputs: int, hidden: int, outputs: int, bounded: bool, rng: np.random.Generator
    ) -> Network:
        """Small weights that keep the layers in the middle of ``tanh``."""
        w1 = rng.normal(0.0, 1.0 / math.sqrt(inputs), hidden * inputs)
        w2 = rng.normal(0.0, 1.0 / math.sqrt(hidden), outputs * hidden)
        vector = np.concatenate((w1, np.zeros(hidden), w2, np.zeros(outputs)))
        return cls(inputs, hidden, outputs, bounded, vector)

    def at(self, parameters: Array) -> Network:
        """The same network with other parameters."""
        return Network(self.inputs, self.hidden, self.outputs, self.bounded, parameters)

    def _split(self) -> tuple[Array, Array, Array, Array]:
        a = self.hidden * self.inputs
        b = a + self.hidden
        c = b + self.outputs * self.hidden
        p = self.parameters
        w1, w2 = p[:a].reshape(self.hidden, self.inputs), p[b:c].reshape(self.outputs, self.hidden)
        return w1, p[a:b], w2, p[c:]

    def __call__(self, x: Array) -> Array:
        """Outputs ``(samples, outputs)`` of inputs ``(samples, inputs)``."""
        w1, b1, w2, b2 = self._split()
        y: Array = np.tanh(x @ w1.T + b1) @ w2.T + b2
        return np.tanh(y) if self.bounded else y

    def with_gradient(self, x: Array) -> tuple[Array, Callable[[Array], tuple[Array, Array]]]:
        """Outputs, and what turns a loss's derivative by them into those by parameters and by inputs."""
        w1, b1, w2, b2 = self._split()
        h = np.tanh(x @ w1.T + b1)
        y: Array = h @ w2.T + b2
        if self.bounded:
            y = np.tanh(y)

        def back(by_output: Array) -> tuple[Array, Array]:
            outer = by_output * (1.0 - y * y) if self.bounded else by_output
            inner = (outer @ w2) * (1.0 - h * h)
            by_parameters = np.concatenate(
                ((inner.T @ x).ravel(), inner.sum(axis=0), (outer.T @ h).ravel(), outer.sum(axis=0))
            )
            return by_parameters, inner @ w1

        return y, back
