"""Bodies that are damaged at a random time, and sound ones, against the watch of the bodies.

``python -m tests.campaign.bodies.damaged_bodies [--onsets N] [--hours H] [--robot NAME ...]``: random motions
(`motions`) of plants written apart from the watch (`plants`), with faults (`damages`) that begin at a random
time; what counts as found in time stands in `watched_runs`.
"""

from __future__ import annotations

import argparse
import random
from collections import Counter
from typing import Final

from contid.control.tick.faults import Fault
from contid.robot_file.load import find_robot_file, load_robot_file
from tests.campaign.bodies.damages import faults_of
from tests.campaign.bodies.plants import axes_of
from tests.campaign.bodies.watched_runs import run, run_sound

ROBOTS: Final = (
    "bend1", "catheter", "cbha", "chain", "chambers3", "finger", "ftdcr_v4", "hand",
    "planar2", "stiffflop1", "stiffflop2", "tendon3", "trirack", "trirack2", "trunk",
)  # fmt: skip

#: Sound bodies of a robot that are computed at once.
SIDE_BY_SIDE: Final = 32


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--onsets", type=int, default=20)
    parser.add_argument("--hours", type=float, default=0.1, help="of sound motion of each robot")
    parser.add_argument("--robot", nargs="*", default=ROBOTS)
    parser.add_argument("--show", action="store_true", help="print what was found late or never")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    total: Counter[str] = Counter()
    alarms, sound_s = 0, 0.0
    for name in asked.robot:
        axes = axes_of(load_robot_file(find_robot_file(name)))[0]
        row = []
        for kind in faults_of(axes):
            draw = random.Random(f"{asked.seed} {name} {kind}")
            runs = [run(axes, draw, 14.0, kind)[0] for _ in range(asked.onsets)]
            counted = [each for each in runs if each.counted_s is not None]
            good = sum(each.in_time for each in counted)
            total[kind] += len(counted)
            total[f"{kind}: in time"] += good
            row.append(f"{kind} {good}/{len(counted)}")
            missed = [each for each in counted if not each.in_time]
            if missed and asked.show:
                print(name, kind, missed)
        if asked.onsets:
            print(f"{name}: {', '.join(row)}", flush=True)
        draw, left_s = random.Random(f"{asked.seed} {name}"), asked.hours * 3600.0
        while left_s > 0.0:
            seconds = min(left_s / SIDE_BY_SIDE, 300.0)
            for body in run_sound(axes, draw, seconds, SIDE_BY_SIDE):
                left_s, sound_s = left_s - seconds, sound_s + body.watched_s
                if body.fault is not Fault.NONE:
                    alarms += 1
                    at = f"after {body.watched_s:.2f} s"
                    print(f"{name}: false alarm {body.fault.name} {at}: {body.message}", flush=True)
        print(f"{name}: {alarms} false alarms in {sound_s / 3600.0:.2f} h so far", flush=True)
    kinds = [kind for kind in total if not kind.endswith(": in time")]
    for kind in kinds:
        print(f"{kind}: {total[f'{kind}: in time']} of {total[kind]} in time")
    whole, found = sum(total[kind] for kind in kinds), sum(total[f"{kind}: in time"] for kind in kinds)
    share, hours = found / max(whole, 1), sound_s / 3600.0
    print(f"{found} of {whole} in time ({share:.2%}); {alarms} false alarms in {hours:.2f} h")


if __name__ == "__main__":
    main()
