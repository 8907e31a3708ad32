"""``python -m ...plugins.program CODE ARGUMENTS...``: as ``python -c``, but forked (tests/README.md)."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the first argument as the main program; it sees the others."""
    code = sys.argv.pop(1)
    exec(compile(code, "<program>", "exec"), {"__name__": "__main__"})


if __name__ == "__main__":
    main()
