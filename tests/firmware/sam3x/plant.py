"""What is wired to the pins of an emulated board: geared motors with encoders, or pressure regulators."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

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
#: PWM unit and bit of port C of each PWM line, and the ADC's channel of A0 to A5, by the datasheet.
PWM_LINES = ((4, 21), (5, 22), (6, 23), (7, 24), (0, 2), (1, 4))
ANALOG = (7, 6, 5, 4, 3, 2)
#: The same of A6 to A11, the load cells.
CELLS = (1, 0, 10, 11, 12, 13)
ADC_MV = 3300.0
_GRAY = (0, 1, 3, 2)


class Motors:
    """First order: ``tau dv/dt = duty v0 - v``. ``shaft`` in counts, ``speed`` in counts/s.

    ``open_track`` keeps the first track of a channel from 2 to 5 at its level; ``sense`` is -1 where the
    wires of a motor are exchanged, ``encoder_of`` the shaft whose encoder a channel reads.
    """

    def __init__(self, board: Sam3x, step: int = STEP, no_load: float = 7630.0, tau_s: float = 0.04) -> None:
        self._board = board
        self._step = step
        self.no_load, self.tau_s = no_load, tau_s
        self.shaft = [0.5] * 6
        self.speed = [0.0] * 6
        self._count = [0] * 6
        self.open_track: dict[int, int] = {}
        self.sense = [1] * 6
        self.encoder_of = list(range(6))
        self.due = board.cpu.cycles
        board.cpu.timed.append(self)

    def duty(self, channel: int) -> float | None:
        """Signed duty; 0 is brake, None is coast, and lines that the board does not drive."""
        unit, letter, a, b = WIRING[channel]
        if self._board.pio["C"].status[0x08] >> PWM_LINES[channel][1] & 1:
            return None
        out = self._board.pio[letter].status[0x38]
        forward, backward = out >> a & 1, out >> b & 1
        if not forward and not backward:
            return None
        share = self._board.pwm.channel(unit, 4) / max(1, self._board.pwm.channel(unit, 0x0C))
        return self.sense[channel] * share * (forward - backward)

    def fire(self) -> None:
        self.due += self._step
        dt = self._step / CLOCK_HZ
        for channel in range(6):
            duty = self.duty(channel)
            if duty is not None:
                self.speed[channel] += (duty * self.no_load - self.speed[channel]) * dt / self.tau_s
            self.shaft[channel] += self.speed[channel] * dt
        for channel, shaft in enumerate(self.encoder_of):
            self._show(channel, math.floor(self.shaft[shaft]))

    def _show(self, channel: int, count: int) -> None:
        if count == self._count[channel]:
            return
        self._count[channel] = count
        if channel < 2:
            self._board.tc[2 * channel].count = count
        else:
            bit = EDGE_BITS[channel]
            gray = _GRAY[count & 3]
            if channel in self.open_track:
                gray = (gray & 1) | self.open_track[channel]
            self._board.pio["D"].set_levels(3 << bit, gray << bit)

    def open(self, channel: int) -> None:
        """Open the first track of an encoder at two pins."""
        self.open_track[channel] = _GRAY[self._count[channel] & 3] & 2


class Regulators:
    """Six regulators with a first order lag: the mean of a PWM pin in, a voltage at the ADC out.

    ``full_bar`` at full duty, read back as ``full_mv``. A line that the PWM unit does not drive is at 0 V
    (1 kOhm to GND). ``pressure_bar`` is what the chambers have.
    """

    def __init__(
        self,
        board: Sam3x,
        step: int = STEP,
        full_bar: float = 3.0,
        full_mv: float = 3125.0,
        tau_s: float = 0.03,
    ) -> None:
        self._board = board
        self._step = step
        self.full_bar, self.full_mv, self.tau_s = full_bar, full_mv, tau_s
        self.pressure_bar = [0.0] * 6
        self.due = board.cpu.cycles
        board.cpu.timed.append(self)

    def duty(self, channel: int) -> float:
        unit, bit = PWM_LINES[channel]
        if self._board.pio["C"].status[0x08] >> bit & 1 or not self._board.pwm.enabled >> unit & 1:
            return 0.0
        return self._board.pwm.channel(unit, 4) / self._board.pwm.channel(unit, 0x0C)

    def fire(self) -> None:
        self.due += self._step
        share = 1 - math.exp(-self._step / CLOCK_HZ / self.tau_s)
        for channel in range(6):
            self.pressure_bar[channel] += (
                self.duty(channel) * self.full_bar - self.pressure_bar[channel]
            ) * share
            millivolt = self.pressure_bar[channel] / self.full_bar * self.full_mv
            self._board.adc.analog[ANALOG[channel]] = min(4095, int(millivolt / ADC_MV * 4095))


#: Keys of an axis that has a `Chamber`.
VALVES: Final[Mapping[str, object]] = {
    "valves": {"outlet": "normally_open"},
    "readback": [[0, 0], [3125, 3]],
    "ceiling_bar": 1.6,
    "slew_bar_s": 20,
    "lag_ms": 1200,
    "leak_ms": 5000,
    "over_ms": 5000,
}


@dataclass
class Chamber:
    """A chamber behind an inlet from a pump and an outlet, which is open without power.

    Filling: ``lag dp/dt = supply - p``; venting: ``lag dp/dt = -p``; the lag grows with the pressure. Each
    valve follows its line late.
    """

    lag_s: float
    supply_bar: float
    opens_s: float = 0.006
    shuts_s: float = 0.004
    swelling: float = 0.0
    leak_per_s: float = 0.0
    pressure_bar: float = 0.0
    powered: tuple[bool, bool] = (False, False)
    fills: bool = False
    vents: bool = True
    _since_s: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def step(self, lines: int, dt: float) -> None:
        """Some time with the lines of inlet (1) and outlet (2) as they are."""
        self.powered = bool(lines & 1), bool(lines & 2)
        self.fills = self._moved(0, self.fills, self.powered[0], dt)
        self.vents = self._moved(1, self.vents, not self.powered[1], dt)
        rise = (self.supply_bar - self.pressure_bar if self.fills else 0.0) - (
            self.pressure_bar if self.vents else 0.0
        )
        lag_s = self.lag_s * (1.0 + self.swelling * self.pressure_bar)
        self.pressure_bar += (rise / lag_s - self.leak_per_s * self.pressure_bar) * dt

    def _moved(self, valve: int, is_open: bool, ordered: bool, dt: float) -> bool:
        self._since_s[valve] = 0.0 if is_open == ordered else self._since_s[valve] + dt
        late_s = self.opens_s if ordered else self.shuts_s
        return ordered if self._since_s[valve] >= late_s else is_open


class Chambers:
    """Chambers at the lines of a board; a line that it does not drive is low, by its pull-down."""

    def __init__(self, board: Sam3x, chambers: Sequence[Chamber], step: int = 20 * STEP) -> None:
        self._board, self._step = board, step
        self.chambers = chambers
        self.due = board.cpu.cycles
        board.cpu.timed.append(self)

    def lines(self, channel: int) -> int:
        """Which valves of a channel have power: 1 the inlet, 2 the outlet."""
        _, letter, inlet, outlet = WIRING[channel]
        driven, level = (self._board.pio[letter].status[at] for at in (0x18, 0x38))
        high = driven & level
        return (high >> inlet & 1) | (high >> outlet & 1) << 1

    def fire(self) -> None:
        self.due += self._step
        for channel, chamber in enumerate(self.chambers):
            chamber.step(self.lines(channel), self._step / CLOCK_HZ)
            millivolt = chamber.pressure_bar / 3.0 * 3125.0
            self._board.adc.analog[ANALOG[channel]] = min(4095, int(millivolt / ADC_MV * 4095))
