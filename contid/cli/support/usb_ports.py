"""The serial port of an adapter, found by unplugging it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from contid.errors import ContidError


def serial_names(root: Path = Path("/dev")) -> dict[str, str]:
    """Stable name (by-id where there is one) of every USB serial port, by device."""
    names = {str(path): str(path) for kind in ("ttyUSB*", "ttyACM*") for path in root.glob(kind)}
    by_id = {str(path.resolve()): str(path) for path in sorted((root / "serial" / "by-id").glob("*"))}
    return {device: by_id.get(str(Path(device).resolve()), name) for device, name in names.items()}


def find_by_unplugging(ask: Callable[[str], None], root: Path = Path("/dev")) -> str:
    """Name of the port that disappears when the person unplugs the adapter.

    Raises:
        ContidError: none or several disappeared.
    """
    before = serial_names(root)
    if not before:
        raise ContidError("no USB serial port is present; plug the adapter in")
    ask("Unplug the adapter")
    gone = sorted(name for device, name in before.items() if device not in serial_names(root))
    if len(gone) != 1:
        found = f"several ports disappeared: {', '.join(gone)}" if gone else "no port disappeared"
        raise ContidError(f"{found}; present were {', '.join(sorted(before.values()))}")
    return gone[0]
