"""``contid track emulate``: an emulated motion-capture room, for trials without one."""

from __future__ import annotations

import click

from contid_mocap.emulate.natnet_server import EmulatedNatNet
from contid_mocap.emulate.scene import EmulatedPose, EmulatedScene
from contid_mocap.emulate.serving import Faults, serve
from contid_mocap.emulate.vicon_server import EmulatedVicon


@click.command()
@click.argument("kind", type=click.Choice(["natnet", "vicon"]))
@click.argument("bodies", nargs=-1)
@click.option("--address", default="127.0.0.1", show_default=True, help="Of the emulated server.")
@click.option(
    "--port", default=0, help="Command port of natnet, target port of vicon; default 1510 or 51001."
)
@click.option("--to", default="127.0.0.1", show_default=True, help="Where vicon sends to.")
@click.option("--multicast", help="Group that natnet sends to; without it to each client.")
@click.option("--data-port", default=1511, show_default=True, help="Of the group.")
@click.option("--rate-hz", default=100.0, show_default=True, help="Frames a second.")
@click.option("--version", default="4.1", show_default=True, help="Of natnet.")
@click.option("--block", default=512, show_default=True, help="Size of the packets of vicon.")
@click.option("--loss", default=0.0, help="Share of the frames that are not sent.")
@click.option("--no-echo", is_flag=True, help="Echo requests of natnet are not answered.")
@click.option("--delay-ms", default=0.0, help="From the exposure to the transmission.")
@click.option("--poses", is_flag=True, help="Poses come on stdin; its end ends the server.")
def command(
    kind: str,
    bodies: tuple[str, ...],
    address: str,
    port: int,
    to: str,
    multicast: str | None,
    data_port: int,
    rate_hz: float,
    version: str,
    block: int,
    loss: float,
    no_echo: bool,
    delay_ms: float,
    poses: bool,
) -> None:
    """Emulate a room of an OptiTrack (natnet) or a Vicon (vicon) system until a signal.

    BODIES are given as NAME=x,y,z in metres and move on circles of 20 mm. With --poses they stand where
    lines on stdin have them: {"NAME": [x, y, z, qx, qy, qz, qw]}, null hides one.
    """
    scene = EmulatedScene(dict(map(_pose, bodies)))
    faults = Faults(loss, delay_ms / 1e3, not no_echo)
    server: EmulatedNatNet | EmulatedVicon
    if kind == "natnet":
        major, _, minor = version.partition(".")
        group = (multicast, data_port) if multicast else None
        server = EmulatedNatNet((address, port or 1510), (int(major), int(minor)), scene, faults, group)
    else:
        server = EmulatedVicon(address, (to, port or 51001), block, scene)
    click.echo(f"ready: {kind} at {address}", err=True)
    serve(server, scene, rate_hz, faults, poses)


def _pose(text: str) -> tuple[str, EmulatedPose]:
    name, _, numbers = text.partition("=")
    x, y, z = (float(number) for number in (numbers or "0,0,0").split(","))
    return name, (x, y, z, 0.0, 0.0, 0.0, 1.0)
