"""The robots of `configs`, and their daemons on simulated devices at rest."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from contid.remote.protocol.socket_path import is_listening
from contid.robot_file.load import configs_folder
from tests.support.daemons import Running, armed, command
from tests.support.waiting import until

SHIPPED = sorted(path.stem for path in configs_folder().glob("*.yaml") if "." not in path.stem)
#: What no robot can move alone from rest. The tip of one section stays on a surface that is level there; two
#: tendons bend in a plane; and a tendon that is pulled alone makes the others slack.
TENDONS = [f"arm s{section}.t{tendon}_mm" for section in (1, 2, 3) for tendon in (1, 2, 3)]
BLOCKED = {
    "bend1": ["arm z_mm"], "catheter": ["arm z_mm"], "planar2": ["arm y_mm"],
    "tendon3": TENDONS, "ftdcr_v4": TENDONS,
}  # fmt: skip


@contextmanager
def shipped(name: str) -> Iterator[Running]:
    """`contid run NAME --mock`, armed, at rest."""
    folder = Path(tempfile.mkdtemp(prefix="contid-"))
    process = subprocess.Popen(
        command(
            "run",
            name,
            "--mock",
            "--rate",
            "50",
            "--socket",
            str(folder / "s"),
            "--recordings",
            str(folder),
        ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    running = Running(process, folder / "s", folder)
    try:
        until(lambda: is_listening(running.socket) or process.poll() is not None, "the daemon listens")
        with running.client() as client:
            armed(client)
        yield running
    finally:
        process.kill()
        process.communicate()
