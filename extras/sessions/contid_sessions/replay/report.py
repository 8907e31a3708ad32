"""The result of a replay as text and as JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

from contid.session.format.metadata import versions
from contid.session.read import Session
from contid.units import DEG
from contid_sessions.replay.compare import Divergence
from contid_sessions.replay.differences import Difference
from contid_sessions.replay.replay import Replayed

_SHOWN: dict[str, tuple[str, float]] = {"m": ("mm", 1e3), "pa": ("bar", 1e-5), "rad": ("deg", 1.0 / DEG)}


def changed_versions(session: Session) -> list[str]:
    """Versions that differ between the recording and now."""
    then = session.metadata["contid"]
    return [
        f"{name}: {then.get(name, '?')} -> {now}"
        for name, now in versions().items()
        if then.get(name, "?") != now
    ]


def as_text(session: Session, replayed: Replayed, changed: list[Difference], took_s: float) -> list[str]:
    """Lines of text."""
    speed = replayed.ticks / session.rate_hz / took_s if took_s > 0 else 0.0
    lines = [f"replay: {replayed.ticks} ticks in {took_s:.1f} s, {speed:.0f} times real time"]
    lines += [f"robot file: {each}" for each in changed]
    lines += [f"version: {each}" for each in changed_versions(session)]
    if replayed.divergence is not None:
        lines += _divergence(replayed.divergence)
        if (worst := replayed.worst) is not None:
            size = _difference(worst).strip(" ()") or f"{worst.replayed - worst.recorded:.3g} {worst.unit}"
            where = f"{worst.where}, tick {worst.tick}"
            lines.append(
                f"ticks that differ: {replayed.different}; largest difference of a command: {size} ({where})"
            )
    elif replayed.ticks == 0:
        lines.append("nothing to compare: no tick was recorded")
    elif replayed.largest > 0.0:
        lines.append(f"every command is within the tolerance; largest difference {replayed.largest:.3g} (SI)")
    else:
        lines.append("every command is the same, bit for bit")
    if replayed.missing:
        lines.append(
            f"{replayed.missing} ticks are not in the recording: the samples beside them took their place"
        )
    if replayed.stopped:
        lines.append(f"stopped after {replayed.ticks} ticks: {replayed.stopped}")
    if session.end.cut:
        lines.append(f"{session.path}: {session.end.cut}; compared as far as it goes")
    return lines


def as_json(session: Session, replayed: Replayed, changed: list[Difference], took_s: float) -> dict[str, Any]:
    """The object for ``--json``."""
    first = replayed.divergence
    divergence: dict[str, Any] | None = None
    if first is not None:
        divergence = {key: _without_nan(value) for key, value in asdict(first).items()}
        divergence["where"] = first.where
    return {
        "ticks": replayed.ticks,
        "took_s": took_s,
        "same": first is None and not replayed.stopped and replayed.ticks > 0,
        "largest": replayed.largest,
        "different": replayed.different,
        "stopped": replayed.stopped,
        "missing": replayed.missing,
        "cut": session.end.cut,
        "robot_file": [str(each) for each in changed],
        "versions": changed_versions(session),
        "divergence": divergence,
    }


def _without_nan(value: Any) -> Any:
    """The same with None for numbers that are not finite, as before the first command: JSON lacks them."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _divergence(found: Divergence) -> list[str]:
    at = f"tick {found.tick} ({found.time_s:.3f} s"
    at += "" if found.source_s != found.source_s else f", {found.source_s:.3f} s of the trajectory"
    unit = f" {found.unit}" if found.unit else ""
    lines = [
        f"first divergence: {at}): {found.where} {found.what}",
        f"  recorded {found.recorded!r}{unit}",
        f"  replayed {found.replayed!r}{unit}{_difference(found)}",
    ]
    last = dict(found.last_equal)
    if not last:
        return [*lines, "  the first tick differs; there is no equal state before it"]
    axes = {name: value for name, value in last.items() if isinstance(value, dict)}
    lines.append(
        f"last equal state: tick {last['tick']}, {found.robot} {last['mode']}, fault {last['fault']}"
    )
    for name, values in axes.items():
        details = ", ".join(f"{what} {value!r}" for what, value in values.items())
        lines.append(f"  {found.robot}.{name}: {details}")
    return lines


def _difference(found: Divergence) -> str:
    """The difference in the unit of robot files."""
    difference = found.replayed - found.recorded
    if difference != difference or not found.unit:
        return ""
    unit, factor = _SHOWN.get(found.unit, (found.unit, 1.0))
    return f" ({difference * factor:+.3g} {unit})"
