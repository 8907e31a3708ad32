"""``contid track emulate``: an emulated motion-capture room, for trials without one."""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import IPv4Address

import click

from contid.cli.support.parameters import NUMBER, POSITIVE, NumberRange, Numbers
from contid.control.process.realtime import EMULATED, request_real_time
from contid.errors import ContidError
from contid_mocap.emulate.natnet_server import EmulatedNatNet
from contid_mocap.emulate.scene import EmulatedPose, EmulatedScene
from contid_mocap.emulate.serving import Faults, serve
from contid_mocap.emulate.vicon_server import EmulatedVicon
from contid_mocap.natnet_command import NATNET_VERSIONS
from contid_mocap.options import ADDRESS

_PORT = click.IntRange(1, 65535)
_PLACE = Numbers(3, 3, NUMBER)


@click.command()
@click.argument("kind", type=click.Choice(["natnet", "vicon"]))
@click.argument("bodies", nargs=-1)
@click.option(
    "--address", type=ADDRESS, default="127.0.0.1", show_default=True, help="Of the emulated server."
)
@click.option(
    "--port", type=_PORT, help="Command port of natnet, target port of vicon; default 1510 or 51001."
)
@click.option("--to", type=ADDRESS, default="127.0.0.1", show_default=True, help="Where vicon sends to.")
@click.option("--multicast", type=ADDRESS, help="Group that natnet sends to; without it to each client.")
@click.option("--data-port", type=_PORT, default=1511, show_default=True, help="Of the group.")
@click.option("--rate-hz", type=POSITIVE, default=100.0, show_default=True, help="Frames a second.")
@click.option(
    "--version", type=click.Choice(list(NATNET_VERSIONS)), default="4.1", show_default=True, help="Of natnet."
)
@click.option(
    "--block",
    type=click.Choice(["256", "512", "1024"]),
    default="512",
    show_default=True,
    help="Size of the packets of vicon.",
)
@click.option("--loss", type=NumberRange(0, 1), default=0.0, help="Share of the frames that are not sent.")
@click.option("--no-echo", is_flag=True, help="Echo requests of natnet are not answered.")
@click.option(
    "--delay-ms", type=NumberRange(min=0), default=0.0, help="From the exposure to the transmission."
)
@click.option("--poses", is_flag=True, help="Poses come on stdin; its end ends the server.")
def command(
    kind: str,
    bodies: tuple[str, ...],
    address: IPv4Address,
    port: int | None,
    to: IPv4Address,
    multicast: IPv4Address | None,
    data_port: int,
    rate_hz: float,
    version: str,
    block: str,
    loss: float,
    no_echo: bool,
    delay_ms: float,
    poses: bool,
) -> None:
    """Emulate a room of an OptiTrack (natnet) or a Vicon (vicon) system until a signal.

    BODIES are given as NAME=x,y,z in metres, or NAME at the origin, and move on circles of 20 mm. With
    --poses they stand where lines on stdin have them: {"NAME": [x, y, z, qx, qy, qz, qw]}, null hides one.
    """
    scene = EmulatedScene(_poses(bodies))
    faults = Faults(loss, delay_ms / 1e3, not no_echo)
    server: EmulatedNatNet | EmulatedVicon
    try:
        if kind == "natnet":
            group = (str(multicast), data_port) if multicast else None
            place = (str(address), port or 1510)
            server = EmulatedNatNet(place, NATNET_VERSIONS[version], scene, faults, group)
        else:
            server = EmulatedVicon(str(address), (str(to), port or 51001), int(block), scene)
    except OSError as error:
        remedy = "--address is one of this machine, --port is free"
        raise ContidError(f"cannot send from {address}: {error.strerror}; {remedy}") from None
    request_real_time(EMULATED)
    click.echo(f"ready: {kind} at {address}", err=True)
    serve(server, scene, rate_hz, faults, poses)


def _poses(bodies: Sequence[str]) -> dict[str, EmulatedPose | None]:
    """Poses by name, position [m] and quaternion, of bodies ``NAME`` or ``NAME=x,y,z``.

    Raises:
        click.BadParameter: a body has no name, no three numbers, or the name of another.
    """
    poses: dict[str, EmulatedPose | None] = {}
    for text in bodies:
        name, _, numbers = text.partition("=")
        if not name:
            raise click.BadParameter(f"{text!r} has no name; NAME=x,y,z is expected", param_hint="BODIES")
        if name in poses:
            raise click.BadParameter(f"{name!r} is given twice", param_hint="BODIES")
        x, y, z = _PLACE.convert(numbers or "0,0,0", None, None)
        poses[name] = (x, y, z, 0.0, 0.0, 0.0, 1.0)
    return poses
