"""The bounded step of a descent: a small quadratic programme in a box.

The specification of ``contid/kernels/cosserat/box_step.hpp``.
"""

from __future__ import annotations

import numpy as np

from contid.kinematics.array import Array


def box_step(H: Array, g: Array, low: Array, high: Array) -> Array:
    """Minimum of ``d H d / 2 + g d`` with low <= d <= high by a primal active set; 0 must be inside.

    Shapes ``(n, n)`` of H, ``(n,)`` of the rest and of the answer. H is positive definite, so the set changes
    finitely often; the cap only guards against rounding.
    """
    n = len(g)
    step = np.zeros(n)
    held = ((step <= low) & (g > 0.0)) | ((step >= high) & (g < 0.0))
    for _ in range(4 * n + 4):
        free = ~held
        if free.any():
            move = np.zeros(n)
            gradient = g + H @ step
            move[free] = np.linalg.solve(H[np.ix_(free, free)], -gradient[free])
            room = np.ones(n)
            up, down = free & (move > 0.0), free & (move < 0.0)
            room[up] = (high[up] - step[up]) / move[up]
            room[down] = (low[down] - step[down]) / move[down]
            fraction = min(1.0, float(np.min(room)))
            step = step + fraction * move
            if fraction < 1.0:
                blocking = int(np.argmin(room))
                step[blocking] = high[blocking] if move[blocking] > 0.0 else low[blocking]
                held[blocking] = True
                continue
        pull = g + H @ step
        wrong = np.where(held, np.where(step <= low, -pull, pull), -np.inf)
        worst = int(np.argmax(wrong))
        if wrong[worst] <= 1e-12 * (1.0 + float(np.abs(g).max())):
            break
        held[worst] = False
    return np.clip(step, low, high)
