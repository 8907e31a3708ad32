"""A contid session as a recording: commanded pulls and the tips that a tracker measured."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import Final

import numpy as np

from contid.errors import ContidError
from contid.kinematics.array import Array
from contid.kinematics.frames import BaseFrame
from contid.session.read import Session
from contid.targets import Vec3
from contid_fit.calibrate.tendon.recording import TendonRecording

#: A measured tip becomes a row when since the row before a tendon moved this far [m] or this time passed [s].
MOTION_M: Final = 0.1e-3
INTERVAL_S: Final = 0.5
#: Sessions have no labels; each interval of this length forms one pattern [s].
PATTERN_S: Final = 10.0
#: Sessions keep measured tips for this time after their capture [s].
OLDEST_S: Final = 1.0


def session_recording(path: Path, robot: str) -> TendonRecording:
    """Rows of one robot of a session, tips in its base frame.

    The model of friction needs rows with some motion between them, so tips without are left out.

    Raises:
        SessionError: not a session.
        ContidError: no such robot, or no tip of it was measured.
    """
    session = Session(path)
    names = [each.name for each in session.layout.robots]
    if robot not in names:
        raise ContidError(f"{path}: no robot {robot!r}; the session has {', '.join(names)}")
    place = names.index(robot)
    frame = BaseFrame.of(session.robot_file().file.robots[robot].base)
    commanded: deque[tuple[float, Array]] = deque(maxlen=round(OLDEST_S * session.rate_hz) + 1)
    newest_s = -math.inf
    times: list[float] = []
    pulls: list[Array] = []
    tips: list[Vec3] = []
    for tick in session.ticks():
        record = tick.robots[place]
        commanded.append((tick.deadline_s, np.array([axis.command for axis in record.axes])))
        # A measurement stays in the records until the next one; its latency may be many ticks. Its age grows
        # with the time of the robots, which skipped ticks do not advance.
        captured_s = (tick.tick - tick.skipped) / session.rate_hz - record.measured_age_s
        if not abs(captured_s - newest_s) > 1e-6:
            continue
        newest_s, at_s = captured_s, tick.deadline_s - record.measured_age_s
        # The pulls at the capture, not those at which the tip arrived.
        pull = min(commanded, key=lambda each: abs(each[0] - at_s))[1]
        if not np.isfinite(record.measured_tip_m).all() or not np.isfinite(pull).all():
            continue
        if times and at_s - times[-1] < INTERVAL_S and np.abs(pull - pulls[-1]).max() < MOTION_M:
            continue
        times.append(at_s)
        pulls.append(pull)
        tips.append(frame.point_in_base(record.measured_tip_m))
    if not times:
        raise ContidError(f"{path}: no tick has a measured tip of {robot!r}; run it with a tracker")
    since = np.array(times) - times[0]
    return TendonRecording(
        str(path),
        tuple(f"{each * PATTERN_S:g} s" for each in (since // PATTERN_S).astype(int)),
        session.layout.robots[place].axes,
        np.array(pulls),
        np.array(tips),
    )
