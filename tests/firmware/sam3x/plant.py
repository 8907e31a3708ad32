"""Six geared motors on the pins of an emulated board: bridges and PWM in, encoder signals out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tests.firmware.sam3x.cpu import CLOCK_HZ

if TYPE_CHECKING:
    from tests.firmware.sam3x.board import Sam3x

STEP = CLOCK_HZ // 20_000  # 50 us: one edge of an encoder at most
#: PWM unit, port and bits of the bridge's inputs, by pins.h and the Due's schematic.
WIRING = (
    (4, "C", 6, 7), (5, "C", 8, 9), (6, "A", 19, 20), (7, "C", 19, 18), (0, "C", 17, 16), (1, "C", 15, 14),
)  # fmt: skip
#: First bit of the encoder in port D of channels 2 to 5; channels 0 and 1 count in TC0 and TC2.
EDGE_BITS = {2: 0, 3: 2, 4: 6, 5: 9}
_GRAY = (0, 1, 3, 2)


class Motors:
    """First order: ``tau dv/dt = duty v0 - v``. ``shaft`` in counts, ``speed`` in counts/s."""

    def __init__(self, board: Sam3x, step: int = STEP, no_load: float = 7630.0, tau_s: float = 0.04) -> None:
        self._board = board
        self._step = step
        self.no_load, self.tau_s = no_load, tau_s
        self.shaft = [0.5] * 6
        self.speed = [0.0] * 6
        self._count = [0] * 6
        self.due = board.cpu.cycles
        board.cpu.timed.append(self)

    def duty(self, channel: int) -> float | None:
        """Signed duty; 0 is brake, None is coast."""
        unit, letter, a, b = WIRING[channel]
        out = self._board.pio[letter].status[0x38]
        forward, backward = out >> a & 1, out >> b & 1
        if not forward and not backward:
            return None
        share = self._board.pwm.channel(unit, 4) / max(1, self._board.pwm.channel(unit, 0x0C))
        return share * (forward - backward)

    def fire(self) -> None:
        self.due += self._step
        dt = self._step / CLOCK_HZ
        for channel in range(6):
            duty = self.duty(channel)
            if duty is not None:
                self.speed[channel] += (duty * self.no_load - self.speed[channel]) * dt / self.tau_s
            self.shaft[channel] += self.speed[channel] * dt
            self._show(channel, math.floor(self.shaft[channel]))

    def _show(self, channel: int, count: int) -> None:
        if count == self._count[channel]:
            return
        self._count[channel] = count
        if channel < 2:
            self._board.tc[2 * channel].count = count
        else:
            bit = EDGE_BITS[channel]
            self._board.pio["D"].set_levels(3 << bit, _GRAY[count & 3] << bit)
