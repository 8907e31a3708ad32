"""``python -m tests.campaign [--all --minutes N | --cases N | --ptys N]``: exit 1 on a violation.

Ctrl-C prints the counts so far.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tests.campaign.campaign import Tally, campaign
from tests.campaign.everything import everything
from tests.campaign.script import machines
from tests.campaign.wired.cases import campaign as wired_campaign
from tests.campaign.wired.checks import Tally as WireTally


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description="The fault campaign.")
    parser.add_argument("--cases", type=int, default=5000, help="in virtual time, on simulated devices")
    parser.add_argument("--ptys", type=int, help="instead this number in real time, on emulated devices")
    parser.add_argument("--driver", default="", help="with --ptys: only its buses, such as dynamixel")
    parser.add_argument("--keep", type=Path, help="with --ptys: folder for sessions that broke an invariant")
    parser.add_argument("--all", action="store_true", help="instead every campaign, for --minutes")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--on", default="", help="with --cases: only robot files with this in their name")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()

    if asked.all:
        return 1 if everything(asked.minutes, asked.seed) else 0
    cases = asked.cases if asked.ptys is None else asked.ptys

    newest: list[Tally | WireTally] = []

    def progress(tally: Tally | WireTally) -> None:
        newest[:] = [tally]
        if sys.stderr.isatty():
            violations = sum(tally.violations.values())
            sys.stderr.write(f"\r\x1b[K{tally.cases}/{cases} cases, {violations} violations")
            sys.stderr.flush()

    try:
        if asked.ptys is None:
            tally: Tally | WireTally = campaign(
                cases, asked.seed, progress, [each for each in machines() if asked.on in each.name]
            )
        else:
            tally = wired_campaign(cases, asked.seed, progress, asked.driver, asked.keep)
    except KeyboardInterrupt:
        if not newest:
            raise
        tally = newest[0]
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
    print(tally.table())
    if sum(tally.violations.values()):
        return 1
    return 0 if tally.cases >= cases else 130


if __name__ == "__main__":
    sys.exit(main())
