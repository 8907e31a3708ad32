"""The states of one robot and every move between them, as one table.

    OFF -> CONNECTING -> READY -> ARMING -> APPROACH -> RUN <-> HOLD -> STOPPING -> OFF,  FAULT from anywhere

In READY every axis has given a valid sample and nothing was commanded; ARMING makes goal := present and
torque on; APPROACH is the jerk-limited way to the first target. A fault is latched: only CLEAR leaves it, to
READY, without motion; from there the robot is armed again and approaches from where it is. A stop or an
emergency stop of a robot in FAULT brings its devices to rest, and leaves it there.
"""

from __future__ import annotations

import enum
from typing import Final

from contid.hal import Rest
from contid.robot_file.base import StopPolicy


class Mode(enum.IntEnum):
    """States of a robot; the numbers are in every record."""

    OFF = 0
    CONNECTING = 1
    READY = 2
    ARMING = 3
    APPROACH = 4
    RUN = 5
    HOLD = 6
    STOPPING = 7
    FAULT = 8


class Event(enum.Enum):
    """Causes of a change of mode."""

    CONNECT = "connect"  # its buses are open; wait for samples
    SAMPLED = "sampled"  # every axis has a valid sample
    ARM = "arm"  # make it ready to move
    ARMED = "armed"  # the devices hold their present position
    FOLLOW = "follow"  # there is a target to go to
    ARRIVED = "arrived"  # the approach ended on the target
    HOLD = "hold"  # stay where you are, or nothing to follow
    STOP = "stop"  # by a policy
    STOPPED = "stopped"  # that policy is done
    ESTOP = "estop"  # relax or vent now
    FAULT = "fault"
    CLEAR = "clear"
    RECOVER = "recover"  # move inside the limits


#: All transitions; every other pair is refused.
MOVES: Final[dict[tuple[Mode, Event], Mode]] = {
    (Mode.OFF, Event.CONNECT): Mode.CONNECTING,
    (Mode.CONNECTING, Event.SAMPLED): Mode.READY,
    (Mode.CONNECTING, Event.STOP): Mode.OFF,
    (Mode.READY, Event.ARM): Mode.ARMING,
    (Mode.READY, Event.STOP): Mode.OFF,
    (Mode.ARMING, Event.ARMED): Mode.APPROACH,
    (Mode.ARMING, Event.HOLD): Mode.HOLD,
    (Mode.ARMING, Event.STOP): Mode.STOPPING,
    (Mode.APPROACH, Event.ARRIVED): Mode.RUN,
    (Mode.APPROACH, Event.HOLD): Mode.HOLD,
    (Mode.APPROACH, Event.STOP): Mode.STOPPING,
    (Mode.RUN, Event.HOLD): Mode.HOLD,
    (Mode.RUN, Event.FOLLOW): Mode.APPROACH,
    (Mode.RUN, Event.STOP): Mode.STOPPING,
    (Mode.HOLD, Event.FOLLOW): Mode.APPROACH,
    (Mode.HOLD, Event.RECOVER): Mode.APPROACH,
    (Mode.HOLD, Event.STOP): Mode.STOPPING,
    (Mode.STOPPING, Event.STOPPED): Mode.OFF,
    (Mode.STOPPING, Event.STOP): Mode.STOPPING,
    (Mode.FAULT, Event.CLEAR): Mode.READY,
    (Mode.FAULT, Event.RECOVER): Mode.READY,
    (Mode.FAULT, Event.STOP): Mode.FAULT,
    **{(mode, Event.ESTOP): Mode.OFF for mode in Mode if mode not in (Mode.OFF, Mode.FAULT)},
    (Mode.FAULT, Event.ESTOP): Mode.FAULT,
    **{(mode, Event.FAULT): Mode.FAULT for mode in Mode if mode is not Mode.FAULT},
}

#: States before the first command.
UNARMED: Final = frozenset({Mode.OFF, Mode.CONNECTING, Mode.READY, Mode.ARMING})
#: States in which a robot can be given a target.
ARMED: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.HOLD})
#: States in which a robot may be in motion.
MOVING: Final = frozenset({Mode.APPROACH, Mode.RUN, Mode.STOPPING})

#: What a stop policy leaves the devices in.
REST_OF: Final[dict[StopPolicy, Rest]] = {
    StopPolicy.HOLD: Rest.HOLD,
    StopPolicy.REST: Rest.HOLD,
    StopPolicy.RELAX: Rest.RELAX,
    StopPolicy.VENT: Rest.VENT,
}
#: From the one that leaves most power to the one that leaves least; ``rest`` also moves the robot.
BY_STRENGTH: Final = (StopPolicy.REST, StopPolicy.HOLD, StopPolicy.RELAX, StopPolicy.VENT)

#: Orders that cause events; other events are not a person's to give.
_ORDERS: Final = {
    Event.CONNECT: "resume",
    Event.ARM: "resume",
    Event.FOLLOW: "move",
    Event.HOLD: "hold",
    Event.STOP: "stop",
    Event.ESTOP: "estop",
    Event.CLEAR: "clear-fault",
    Event.RECOVER: "recover",
}


def stronger(policy: StopPolicy, other: StopPolicy | None) -> StopPolicy:
    """The one of two stop policies that leaves less power in the devices."""
    return policy if other is None else max(policy, other, key=BY_STRENGTH.index)


def move(mode: Mode, event: Event) -> Mode | None:
    """The mode after ``event``, or None when it is not allowed."""
    return MOVES.get((mode, event))


def order_of(event: Event) -> str:
    """The order that causes an event, as a person gives it; the event itself where none does."""
    return _ORDERS.get(event, event.value)


def allowed(mode: Mode) -> tuple[str, ...]:
    """Orders that are allowed in a state, for messages that refuse one."""
    return tuple(dict.fromkeys(order for event, order in _ORDERS.items() if (mode, event) in MOVES))
