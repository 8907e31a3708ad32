"""Configuration of the robots: built once, plain values, constant during a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from contid.control.tick.follow.expected_range import AxisResponse
from contid.control.tick.follow.responses import axis_responses
from contid.control.tick.limits import AxisLimits, axis_limits
from contid.control.tick.shaping import ShaperChoice
from contid.control.tick.shared_limits import SharedLimits
from contid.control.tick.squeezing import Squeezes
from contid.control.tick.taut import lift_n
from contid.control.tick.transmission import RobotTransmission
from contid.hal import DeviceResponse, Sample
from contid.kernels import load
from contid.kinematics.extra_axes import build_whole_model
from contid.kinematics.frames import BaseFrame
from contid.kinematics.model import Model
from contid.robot_file.base import ContactPolicy, Quantity, Stops, TipFeedback
from contid.robot_file.cosserat import Cosserat
from contid.robot_file.needs import load_squeezes
from contid.robot_file.rack_finger import CurrentSense, RackFinger
from contid.robot_file.robot import RobotDescription
from contid.targets import Actuation
from contid.units import BAR

if TYPE_CHECKING:
    from contid.kinematics.tendon.capstan import CapstanLead
    from contid.kinematics.tendon.taut import TautPulls

#: Version of the rules by which motions begin and go on; a recording is replayed by its own.
#: 0: as if the axes did not accelerate. 1: from their present acceleration, so that the jerk holds, also on
#: live streams of tendon robots. 2: on live streams also of axes that accelerate towards a limit, beside
#: limits that axes share, and where a motion ends on a limit. 3: a straight line to a row on such a limit
#: leads to the row itself, and no way is rounded in motion (`contid.trajectory.pursuit.Lines`); a path slows
#: while a body is behind (`contid.control.engine.watch.path_pace`); how far axes go on that stop is a bound.
#: 4: late rows of a live stream are expected to go on as those before, and met smoothly; rows that waited are
#: no new period (`contid.control.engine.live`); a robot on its way to a goto stops before a source moves
#: it; a fault is not cleared while the robot brakes. 5: a correction of the tip of a robot without a target
#: that began to fade is whole again with the next measurement. 6: a model that fails where a stage of the
#: tick asks it is a fault of its robot; robots whose bodies are kept apart from it hold; a fault is not
#: cleared while an axis repeats an old measurement; a robot whose fault was cleared is not compared with its
#: last command; the clock of a live stream begins as slowly as its rows allow, and each expected row is left
#: behind on a way of its own (`contid.control.engine.live`); the pace of a path that is slowed changes within
#: half of the jerk, and motions that begin meanwhile are planned by it. 7: the nearest pose to tips out of
#: reach is followed from itself, however far the axes are behind it, and not searched for in every tick. 8:
#: axes that share limits stop before an approach or the way to rest, which are straight lines, and stop as
#: their live targets were compared with the limits: in each tick of a stop (``kernels/limiter/guard.hpp``); a
#: tip takes no straight line that is far slower than its axes (`contid.control.engine.live.tip_line`). 9:
#: rows of a live stream come by a clock that counts skipped ticks (`contid.control.engine.live.row_clock`).
#: 10: rows that waited while ticks were skipped count as of when they were expected; the clock of a live
#: stream that begins again keeps its period (`contid.control.engine.live.producer_clock`); a trajectory
#: stands while orders, or faults that a client may clear, keep every robot from following it
#: (`contid.control.engine.sources`); models are asked less often for bodies that are kept apart, and a body
#: too short to meet itself is kept from that as it gets longer (``extras/clearance``).
MOTION_RULES: Final = 10
#: Data younger than this are never stale: a slow regulator measures at 20 Hz or so.
STALE_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class FeedbackConfig:
    """The numbers of `TipFeedback` in SI as plain values."""

    gain_per_s: float
    limit_m: float
    stale_s: float
    fade_s: float

    @classmethod
    def of(cls, feedback: TipFeedback) -> FeedbackConfig:
        """Of the ``feedback`` of a robot file."""
        return cls(
            feedback.gain_per_s, feedback.limit_mm / 1e3, feedback.stale_ms / 1e3, feedback.fade_ms / 1e3
        )


@dataclass(frozen=True, slots=True)
class RobotConfig:
    """Everything fixed about one robot.

    Attributes:
        name: in the robot file.
        kind: its model's name.
        quantity: of the model's axes: lengths or pressures.
        quantities: of every axis; extra ones may be angles.
        model: kinematics in the base frame; its axes include the extra ones.
        frame: the base frame in the world.
        limits: per axis, per tick.
        transmission: actuation to device values and back.
        axis_names: of the model, then of the extra axes.
        extra_axes: how many of them are extra.
        axes: names on the buses, in the same order.
        rest: the rest pose.
        stops: policy per reason.
        velocity, acceleration, jerk: greatest rates of every axis [1/s, 1/s^2, 1/s^3].
        tolerance: exchanges in a row each axis may miss.
        stale_s: age at which the data of each axis count as stale [s].
        watchdog_s: shortest time after which a device of the robot stops by itself [s], 0 when not known.
        period_s: of the tick.
        feedback: closed loop on the tip, None when off.
        play: half width of the play of every axis [m or Pa], None without.
        loops: half width of the hysteresis loop of every regulator [Pa], None without.
        capstan: lead of the friction of tendons in the bends, None without.
        taut: bounds of the tensions of a tendon robot, None without.
        lift_n: how far its tensions stand above the floor on a live stream [N].
        sensing: description of an arm that senses the force on its tip, None without.
        stages: stages of the tick that its robot file asks for (`contid.control.engine.stages`).
        contact: what it does after a contact, None when none is looked for.
        usual_a, contact_a: current of an axis without a contact, and what is one above it [A]; 0 when
            currents show none.
        nm_per_a: torque of an axis per its current [N m/A], 0 when it is not stated.
        straight: approaches are straight lines of the axes, which keep limits that several axes share.
        shared: limits that the model's own axes share, None without.
        responses: how every axis answers its commands when it is healthy.
        follow_tip_m: how far the tip of the measured axes may be off the way of the commands; None unwatched.
        shaping: of what goes to the devices, None without.
        motion_rules: `MOTION_RULES`, or those of the recording that is replayed.
        guard: the stop checks of a live stream, compiled (``contid/kernels/limiter/guard.hpp``).
    """

    name: str
    kind: str
    quantity: Quantity
    quantities: tuple[Quantity, ...]
    model: Model
    frame: BaseFrame
    limits: tuple[AxisLimits, ...]
    transmission: RobotTransmission
    axis_names: tuple[str, ...]
    extra_axes: int
    axes: tuple[str, ...]
    rest: Actuation
    stops: Stops
    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    tolerance: tuple[int, ...]
    stale_s: tuple[float, ...]
    watchdog_s: float
    period_s: float
    feedback: FeedbackConfig | None = None
    play: Actuation | None = None
    loops: Actuation | None = None
    capstan: CapstanLead | None = None
    taut: TautPulls | None = None
    lift_n: float = 0.0
    sensing: Cosserat | None = None
    stages: tuple[str, ...] = ()
    contact: ContactPolicy | None = None
    usual_a: float = 0.0
    contact_a: float = 0.0
    nm_per_a: float = 0.0
    squeezes: Squeezes | None = None
    straight: bool = False
    shared: SharedLimits | None = None
    responses: tuple[AxisResponse, ...] = ()
    follow_tip_m: float | None = None
    shaping: ShaperChoice | None = None
    motion_rules: int = MOTION_RULES
    guard: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Build what the kernel needs of the above."""
        kernel, taut = load("limiter"), self.taut
        pulls = (None, (), ()) if taut is None else (taut.kernel, taut.lower, taut.upper)
        rates = self.velocity, self.acceleration, self.jerk
        guard = kernel.RobotGuard(
            self.limits, *rates, self.period_s, self.extra_axes, self.motion_rules, self.shared, *pulls
        )
        object.__setattr__(self, "guard", guard)

    @property
    def measurements_move_targets(self) -> bool:
        """True with tip feedback or an estimated load: targets may leave the reach that was checked."""
        estimated = self.sensing is not None and self.sensing.load == "estimated"
        return self.feedback is not None or estimated

    def measured_actuation(self, samples: Sequence[Sample]) -> Actuation | None:
        """Where the axes are, None unless every one of them has a valid sample."""
        values = [sample.value for sample in samples if sample.valid and sample.value is not None]
        return self.transmission.to_actuation(values) if len(values) == len(self.axes) else None


def robot_config(
    name: str,
    robot: RobotDescription,
    transmission: RobotTransmission,
    rate_hz: float,
    tolerance_of_bus: Mapping[str, int],
    watchdog_s_of_bus: Mapping[str, float],
    *,
    devices: Mapping[str, DeviceResponse] = MappingProxyType({}),
) -> RobotConfig:
    """Configuration of one robot of a file at a rate [Hz]; ``devices``: response by axis of the robot."""
    model = build_whole_model(robot)
    taut: TautPulls | None = getattr(model, "taut", None)
    names = robot.all_axis_names
    tolerance = tuple(tolerance_of_bus[robot.axes[axis].bus] for axis in names)
    period_s = 1.0 / rate_hz
    velocity, acceleration, jerk = robot.rate_limits
    sense = robot.sense if isinstance(robot, Cosserat | RackFinger) else None
    currents = sense if isinstance(sense, CurrentSense) else None
    return RobotConfig(
        name=name,
        kind=robot.model,
        quantity=robot.quantity,
        quantities=robot.quantities,
        model=model,
        frame=BaseFrame.of(robot.base),
        limits=axis_limits(model.lower, model.upper, velocity, acceleration, period_s),
        transmission=transmission,
        axis_names=names,
        extra_axes=len(robot.extra_axis_names),
        axes=tuple(f"{name}.{axis}" for axis in names),
        # Extra axes rest at their least value: without pressure, open.
        rest=(*robot.rest, *model.lower[len(robot.axis_names) :]),
        stops=robot.stop,
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        tolerance=tolerance,
        stale_s=tuple(max(ticks * period_s, STALE_S) for ticks in tolerance),
        watchdog_s=min(
            filter(None, (watchdog_s_of_bus[robot.axes[axis].bus] for axis in names)), default=0.0
        ),
        period_s=period_s,
        feedback=None if robot.feedback is None else FeedbackConfig.of(robot.feedback),
        play=None if robot.backlash is None else (*robot.backlash, *(0.0,) * len(robot.extra_axis_names)),
        loops=_loops(robot),
        capstan=getattr(model, "capstan", None),
        taut=taut,
        lift_n=0.0 if taut is None else lift_n(taut, acceleration, jerk),
        sensing=robot if isinstance(robot, Cosserat) and robot.sense is not None else None,
        stages=robot.stages,
        contact=None if sense is None else sense.contact,
        usual_a=0.0 if currents is None else currents.usual_ma / 1e3,
        contact_a=0.0 if currents is None else currents.contact_ma / 1e3,
        nm_per_a=0.0 if currents is None or currents.nm_per_a is None else currents.nm_per_a,
        squeezes=_squeezes(name, robot),
        straight=taut is not None or getattr(model, "straight_approach", False),
        shared=getattr(model, "shared", None),
        responses=axis_responses(robot, transmission, devices, period_s),
        follow_tip_m=None if robot.follow_tip_mm is None else robot.follow_tip_mm / 1e3,
        shaping=None
        if robot.rates.shape is None
        else ShaperChoice.of(robot.rates.shape, robot.quantity, period_s),
    )


def _squeezes(name: str, robot: RobotDescription) -> Squeezes | None:
    """What closes the tip of a robot until a force, None where no force follows from its currents."""
    if not isinstance(robot, RackFinger) or robot.sense is None or robot.sense.nm_per_a is None:
        return None
    found: Squeezes = load_squeezes(name)
    return found


def _loops(robot: RobotDescription) -> Actuation | None:
    """Half the loops that a calibration found; a positive ``loop_bar`` is no loop of a chamber that lags."""
    error = robot.correction if isinstance(robot, Cosserat) else None
    if error is None:
        return None
    return (*(max(-half, 0.0) * BAR for half in error.loop_bar), *(0.0,) * len(robot.extra_axis_names))
