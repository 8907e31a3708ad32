"""``python -m tests.campaign [--cases N] [--seed N]``: exit 1 when anything was violated."""

from __future__ import annotations

import argparse
import sys

from tests.campaign.campaign import Tally, campaign


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description="The fault campaign.")
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()

    def progress(tally: Tally) -> None:
        if sys.stderr.isatty():
            sys.stderr.write(
                f"\r\x1b[K{tally.cases}/{asked.cases} cases, {sum(tally.violations.values())} violations"
            )
            sys.stderr.flush()

    tally = campaign(asked.cases, asked.seed, progress)
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
    print(tally.table())
    return 1 if sum(tally.violations.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
