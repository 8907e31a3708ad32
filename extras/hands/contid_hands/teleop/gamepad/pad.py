"""A gamepad as the operator uses it: deflections and orders, which count only under the dead-man button.

A motion begins with a press of the dead-man button while every axis is centred, and ends with its release. So
a device that is deflected or pressed at the start, or after lost events, moves nothing until it is released.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from contid_hands.teleop.gamepad.device import Capabilities, InputDevice
from contid_hands.teleop.gamepad.events import (
    EV_ABS,
    EV_KEY,
    EV_REL,
    EV_SYN,
    SYN_DROPPED,
    SYN_REPORT,
    InputEvent,
)
from contid_hands.teleop.gamepad.mapping import BoundInput, BoundMapping

#: A deflected 3D mouse sends its relative axes at least every 20 ms, and nothing when it is centred.
RELATIVE_S: Final = 0.1
ESTOP: Final = "estop"
_PRESSED: Final = 1


@dataclass(frozen=True, slots=True)
class PadState:
    """State of a gamepad.

    Attributes:
        held: the dead-man button was held since the last state; False once after each release.
        orders: names of the orders whose buttons were pressed since the last state.
    """

    held: bool
    orders: tuple[str, ...]


class Gamepad:
    """Reads a device.

    Attributes:
        mapping: what its buttons and axes do.
    """

    def __init__(self, device: InputDevice, mapping: BoundMapping) -> None:
        self.mapping = mapping
        self._device = device
        self._inputs = frozenset((each.type, each.code) for each in mapping.inputs)
        self._orders = {**mapping.orders, mapping.estop: ESTOP}
        self._values: dict[tuple[int, int], float] = {}
        self._since_s: dict[tuple[int, int], float] = {}
        self._held = self._pressing = self._lost_events = self._released = False
        self._event_s = float("-inf")
        self._take_present()

    def poll(self, now_s: float) -> PadState:
        """Take in the events since the last call.

        Raises:
            DeviceLostError: the device is gone; nothing is held any more.
        """
        orders: list[str] = []
        self._released = False
        try:
            for event in self._device.events():
                self._event_s = now_s
                self._take(event, now_s, orders)
        except BaseException:
            self.release()
            raise
        if self._held and self._silent(now_s):
            self.release()
        return PadState(self._held and not self._released, tuple(orders))

    def release(self) -> None:
        """Nothing is held until the dead-man button is pressed again with every axis centred."""
        self._held = self._pressing = False
        self._released = True

    def share(self, found: BoundInput | None, now_s: float) -> float:
        """Share of the speed that an axis asks for, -1 to 1."""
        if found is None:
            return 0.0
        key = (found.type, found.code)
        if found.type == EV_REL and now_s - self._since_s.get(key, float("-inf")) > RELATIVE_S:
            return 0.0
        return found.share(self._values.get(key, found.centre))

    def centred(self, now_s: float) -> bool:
        """Every axis is within its dead-band."""
        return not any(self.share(each, now_s) for each in self.mapping.inputs)

    def _silent(self, now_s: float) -> bool:
        silence_s = self.mapping.silence_s
        return silence_s is not None and now_s - self._event_s > silence_s and not self.centred(now_s)

    def _take(self, event: InputEvent, now_s: float, orders: list[str]) -> None:
        if event.type == EV_SYN and event.code == SYN_DROPPED:
            self._lost_events = True
            self.release()
        elif event.type == EV_SYN and event.code == SYN_REPORT:
            if self._lost_events:
                self._lost_events = False
                if self.mapping.estop in self._take_present().pressed:
                    orders.append(ESTOP)
            elif self._pressing:
                self._pressing = False
                self._held = self.centred(now_s)
        elif self._lost_events:
            return  # incomplete until the next report
        elif event.type == EV_KEY:
            self._button(event, orders)
        elif event.type in (EV_ABS, EV_REL) and (event.type, event.code) in self._inputs:
            self._values[event.type, event.code] = event.value
            self._since_s[event.type, event.code] = now_s

    def _button(self, event: InputEvent, orders: list[str]) -> None:
        if event.code == self.mapping.dead_man:
            if event.value == 0:
                self.release()
            elif event.value == _PRESSED:
                self._pressing = True
        elif event.value == _PRESSED and event.code in self._orders:
            orders.append(self._orders[event.code])

    def _take_present(self) -> Capabilities:
        """The state of the axes; a button that is pressed already has to be pressed again."""
        present = self._device.present()
        self._values.update({(EV_ABS, code): info.value for code, info in present.absolute.items()})
        self._held = self._pressing = False
        return present
