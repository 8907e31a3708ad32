"""Robot files that are broken on purpose."""

from __future__ import annotations

import random
from pathlib import Path

VALUES = (
    *("", "-1", "0", "1e9", "1e-300", "[]", "{}", "[1, 2]", "{a: 1}", "abc", ".nan", "true", "null"),
    *("[[1, 2], [3]]", "'x'", "*none", "!t 1"),
)


def broken(text: str, dice: random.Random) -> str:
    """One to four lines deleted, doubled, cut, with another value or another unit."""
    lines = text.split("\n")
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(lines))
        line = lines[at]
        match dice.randrange(5):
            case 0:
                lines[at : at + 1] = []
            case 1:
                lines.insert(at, line)
            case 2:
                lines[at] = line[: dice.randint(0, len(line))]
            case 3:
                lines[at] = line.replace("_m", "_x", 1)
            case _ if ":" in line:
                key, _, rest = line.partition(":")
                lines[at] = f"{key}: {dice.choice(VALUES)}{rest[rest.find(',') :] if ',' in rest else ''}"
        lines = lines or [""]
    return "\n".join(lines)


def robot_files() -> list[Path]:
    return sorted((Path(__file__).parent.parent.parent / "configs").glob("*.yaml"))
