"""Control file of an emulator: a text file to which fault switches are appended, one JSON object per line."""

from __future__ import annotations

from pathlib import Path


class ControlFile:
    """Yields the lines appended to a file since it was created."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.touch()
        self._at = path.stat().st_size

    def new_lines(self) -> list[str]:
        """Whole lines added since the last call."""
        if not self.path.exists() or self.path.stat().st_size <= self._at:
            return []
        with self.path.open("rb") as file:
            file.seek(self._at)
            data = file.read()
        whole = data[: data.rfind(b"\n") + 1]
        self._at += len(whole)
        return [line for line in whole.decode(errors="replace").splitlines() if line.strip()]

    def report_error(self, line: str, error: Exception) -> None:
        """Append a refused line and its error to ``PATH.errors``."""
        with self.path.with_name(self.path.name + ".errors").open("a") as errors:
            errors.write(f"{line.strip()}: {error}\n")
