"""The load of rubbing tendons is renewed on the clock of the servos, virtual or real."""

from __future__ import annotations

import numpy as np

from contid_emulate.dynamixel import Servo
from contid_emulate.dynamixel.tendon_friction import FrictionPlant


def test_a_load_is_renewed_after_ten_milliseconds_of_the_servo() -> None:
    servos = [Servo(1, position_ticks=20.0), Servo(2, position_ticks=20.0)]
    plant = FrictionPlant(
        *(servos, (1, 1), (0.0, 0.0), (1.0, 1.0), np.array([[400.0, 0.0], [-400.0, 0.0]]), (1e5, 1e5)),
        backlash_ticks=(1.0, 1.0),
        capstan=(0.1,),
    )
    loads = []
    for ms in (0, 4, 20, 24):
        servos[0].now, servos[0].motion.position = ms / 1e3, 20.0 + 5.0 * ms
        loads.append(plant.load_ma(0))
    assert loads[0] == loads[1]
    assert loads[2] < loads[1] - 10.0
    assert loads[3] == loads[2]
