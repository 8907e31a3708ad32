"""A linear ARX model of the trunk under predictive control, as its makers run it: the baseline.

The tip of the next step is a linear function of the last tips and commands, fitted to the recording of 0 g.
At every step the commands of a horizon are those with the least squares of the path's error and of the
commands' changes; the first goes out, within the limits of the motors. Steps are 20 ms, as theirs.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from contid.kinematics.array import Array
from contid_identify.split import split_time
from studies.moving.recordings import MOTORS, PERIOD_S, columns, smooth, table
from studies.moving.trunk_twin import DELAY, LIMIT_DEG, PLANE, Trunk, terms

EVERY: Final = 2
TIPS: Final = 4
#: Past commands reach over the dead time of the runs, by which those of the recording are made later.
COMMANDS: Final = 20
HORIZON: Final = 30
#: What a change of the commands by their whole range counts, beside an error of 1 mm.
CHANGE: Final = 6.0
RIDGE: Final = 1e-4


class Arx:
    """Model and gains; it remembers the last tips and commands.

    Args:
        by_tips: ``(TIPS, 2, 2)``, the newest first.
        by_commands: ``(COMMANDS, 6, 2)`` by commands as shares of their range.
        constant: ``(2,)`` [mm].
    """

    def __init__(self, by_tips: Array, by_commands: Array, constant: Array) -> None:
        self._tips, self._commands = np.zeros((TIPS, 2)), np.zeros((COMMANDS, 6))
        self._model = by_tips, by_commands, constant
        # The answer to one command of each motor that stays: what later steps add.
        answers = np.zeros((HORIZON, 2, HORIZON, 6))
        for motor in range(6):
            held = np.zeros((HORIZON, 6))
            held[:, motor] = 1.0
            step = self._ahead(np.zeros((TIPS, 2)), np.zeros((COMMANDS, 6)), held, np.zeros(2))
            for begun in range(HORIZON):
                answers[begun:, :, begun, motor] = step[: HORIZON - begun]
        changes = answers.reshape(2 * HORIZON, 6 * HORIZON)
        weight = CHANGE * np.eye(6 * HORIZON)
        self._gain = np.linalg.solve(changes.T @ changes + weight.T @ weight, changes.T)[:6]

    def next(self, tip: Array, sent: Array, path: Array) -> Array:
        """Angles of the next step [deg] for a measured tip, the last angles and the path of the horizon."""
        self._tips = np.vstack((tip, self._tips[:-1]))
        self._commands = np.vstack((sent / LIMIT_DEG, self._commands[:-1]))
        stays = np.repeat(self._commands[:1], HORIZON, axis=0)
        free = self._ahead(self._tips, self._commands, stays, self._model[2])
        return np.asarray(LIMIT_DEG * (self._commands[0] + self._gain @ (path - free).ravel()))

    def _ahead(self, tips: Array, commands: Array, later: Array, constant: Array) -> Array:
        by_tips, by_commands, _ = self._model
        found = []
        for row in later:
            commands = np.vstack((row, commands[:-1]))
            tip = np.einsum("ki,kij->j", tips, by_tips) + np.einsum("ki,kij->j", commands, by_commands)
            tips = np.vstack((tip + constant, tips[:-1]))
            found.append(tips[0])
        return np.array(found)


def fitted_arx(model: Trunk) -> Arx:
    """Of the recording of 0 g, whose commands are made later by what the dead time of the runs is longer."""
    of = table("trunk-dynamic/random_a_0g.csv.gz")
    sent = columns(of, [f"u{k}_deg" for k in MOTORS]) / LIMIT_DEG
    tip = smooth(columns(of, ["x3_mm", "y3_mm", "z3_mm"]))[:, PLANE]
    # Places from the straight robot, as the twin's.
    still = np.vstack(
        (np.zeros((model.delay, terms(sent).shape[1])), model.mode.filtered(terms(sent * LIMIT_DEG)))
    )
    tip = tip - np.median(tip - (still[: len(tip)] @ model.weights)[:, PLANE], axis=0)
    later = DELAY - model.delay
    sent = np.vstack((np.repeat(sent[:1], later, axis=0), sent[:-later]))[::EVERY]
    tip = tip[::EVERY]
    rows = np.arange(COMMANDS, len(tip) - 1)
    rows = rows[split_time(EVERY * PERIOD_S * rows).fitted][::2]
    inputs = np.column_stack(
        [tip[rows - k] for k in range(TIPS)]
        + [sent[rows + 1 - k] for k in range(COMMANDS)]
        + [np.ones(len(rows))]
    )
    size = inputs.std(axis=0) + 1e-9
    size[-1] = 1.0
    a = inputs / size
    normal = a.T @ a + RIDGE * len(a) * np.eye(a.shape[1])
    weights = np.linalg.solve(normal, a.T @ tip[rows + 1]) / size[:, None]
    return Arx(
        weights[: 2 * TIPS].reshape(TIPS, 2, 2), weights[2 * TIPS : -1].reshape(COMMANDS, 6, 2), weights[-1]
    )
