"""Contacts of the tip of the simulated arm with walls, and spirals without any, beside their detector."""

import math
from dataclasses import dataclass

import numpy as np

from contid.robot_file.clearance import PlaneDescription
from contid.robot_file.pneumatic.simulated import SimulatedArm
from contid_fit.sense.live.tip_contact import TipContact
from tests.sense.observed import ERRORS, GRAM_N, RATE_HZ, Loaded, Run, calibrated, pascal, plant
from tests.sense.plant import shipped_robot

PHASES = np.array([0.0, 2.0, 4.0, 1.0, 3.0, 5.0]) * math.pi / 3.0
#: Onset of a contact: the wall pushes with so much [N].
ONSET_N = 1e-3


class ContactRun(Run):
    """Ticks of estimate and contact detector beside the plant."""

    def __init__(self, robot, body, rng):
        super().__init__(robot, body, rng)
        self.contact = TipContact(robot, self.observer.arm, self.observer.swing)
        self.contacts = []

    def tick(self, bar):
        super().tick(bar)
        found = self.contact.tick(self.observer.trace, self.newest, self.observer.found)
        if found is not None:
            self.contacts.append((self.ticks / RATE_HZ, found))

    def begin(self, bar):
        """From the arm without pressure through the loops of all axes to pressures, then rest."""
        self.bar = np.zeros(6)
        self.tick(self.bar)
        self.move(np.asarray(bar) + 0.15)
        self.move(np.asarray(bar))
        self.rest(3.0)


@dataclass
class Push:
    """A contact with a wall.

    Attributes:
        speed_mm_s: of the tip before it.
        touch_s, onset_s: of the wall, and when it pushed with `ONSET_N`; NaN where it never did.
        found_s: when it was found; NaN when it was not.
        push_n: of the wall then.
        depth_mm: of the tip without a wall behind the one with it, then.
        angle_deg: between the direction that was found and the normal of the wall.
        force_n: that was found.
        early: contacts found before.
    """

    speed_mm_s: float
    touch_s: float
    onset_s: float
    found_s: float
    push_n: float
    depth_mm: float
    angle_deg: float
    force_n: float
    early: int


def with_wall(point_m, normal):
    wall = PlaneDescription(point_mm=tuple((1e3 * point_m).tolist()), normal=tuple(normal.tolist()))
    return Loaded(shipped_robot().model_copy(update={"sim": SimulatedArm(errors=ERRORS, wall=wall)}))


def push(seed, beyond_s=1.0):
    """Run into a wall somewhere, with some payload and speed; None where the way meets it otherwise."""
    rng = np.random.default_rng(1000 + seed)
    robot = calibrated(plant(), rng)
    load = (0.0, 0.0, rng.uniform(0.0, 10.0) * GRAM_N) if seed % 2 else (0.0, 0.0, 0.0)
    low, high = rng.uniform(0.1, 1.0, (2, 6))
    seconds = math.exp(rng.uniform(math.log(1.5), math.log(8.0)))
    free = plant()
    free.force = load
    free.follow([0.0] * 6)
    ways = [np.array(free.tip_in_world_m(0.0))]
    for share in (*np.linspace(-1.0, 0.0, 10) * 0.15, *np.linspace(0.0, 0.52, 25)):
        free.follow(pascal(low - min(share, 0.0) + (high - low) * max(share, 0.0)))
        ways.append(np.array(free.tip_in_world_m(0.0)))
    point, along = ways[-1], ways[-1] - ways[-4]
    tilt = rng.normal(size=3)
    normal = -(along / np.linalg.norm(along) + 0.5 * tilt / np.linalg.norm(tilt))
    normal /= np.linalg.norm(normal)
    if min((each - point) @ normal for each in ways[:-2]) < 5e-4:
        return None
    body, free = with_wall(point, normal), plant()
    body.force = free.force = load
    for each in (body, free):
        each.follow([0.0] * 6)
        each.tip_in_world_m(0.0)
    run = ContactRun(robot, body, rng)
    run.begin(low)
    if not run.contact.armed or body.push_n > 0.0:
        return None
    early = len(run.contacts)
    speed = touch_s = onset_s = math.nan
    tip = np.zeros(3)
    free.follow(pascal(low + 0.15))
    for k in range(round((seconds + 0.5) * RATE_HZ)):
        u = min(k / (RATE_HZ * seconds), 1.0)
        bar = low + (high - low) * (u * u * (3.0 - 2.0 * u))
        run.tick(bar)
        free.follow(pascal(bar))
        now_s, before = run.ticks / RATE_HZ, tip
        held, tip = (1e3 * np.array(each.tip_in_world_m(0.0)) for each in (body, free))
        if math.isnan(touch_s):
            early = len(run.contacts)
            if body.push_n > 0.0:
                touch_s, speed = now_s, float(np.linalg.norm(tip - before)) * RATE_HZ
        if math.isnan(onset_s) and body.push_n >= ONSET_N:
            onset_s = now_s
        if len(run.contacts) > early:
            found_s, found = run.contacts[early]
            angle = math.degrees(math.acos(np.clip(np.dot(found.direction_in_base, normal), -1.0, 1.0)))
            depth = float(np.linalg.norm(held - tip))
            return Push(
                speed, touch_s, onset_s, found_s, body.push_n, depth, angle, found.force_n, early
            )  # fmt: skip
        if now_s > touch_s + beyond_s:
            break
    if math.isnan(touch_s):
        return None
    return Push(speed, touch_s, onset_s, math.nan, body.push_n, math.nan, math.nan, math.nan, early)


def spiral(seed, minutes):
    """Contacts found on a spiral without any, largest squared distance, share of the time it looked."""
    rng, body = np.random.default_rng(5000 + seed), plant()
    robot = calibrated(body, rng)
    if seed % 2:
        body.force = (0.0, 0.0, rng.uniform(0.0, 10.0) * GRAM_N)
    centre, period_s, widest = rng.uniform(0.45, 0.75), rng.uniform(3.0, 10.0), rng.uniform(0.15, 0.4)
    phases = PHASES + rng.uniform(0.0, 2.0 * math.pi)
    run = ContactRun(robot, body, rng)
    run.begin(centre + 0.1 * np.sin(phases))
    largest, looked, count = 0.0, 0, round(60.0 * minutes * RATE_HZ)
    for k in range(count):
        t = k / RATE_HZ
        radius = 0.1 + (widest - 0.1) * 0.5 * (1.0 - math.cos(2.0 * math.pi * t / 40.0))
        run.tick(centre + radius * np.sin(2.0 * math.pi * t / period_s + phases))
        if run.contact.armed:
            looked += 1
            largest = max(largest, run.contact.distance)
    return run.contacts, largest, looked / count
