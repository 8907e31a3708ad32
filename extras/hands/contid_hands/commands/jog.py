"""``contid jog``: a robot moved by the keys of a terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import click

from contid.cli.support.orders import socket_option
from contid.cli.support.parameters import NumberRange

#: How long after it is made a request of a press may begin to move the robot [s]: the daemon refuses one that
#: waited longer. It is independent of ``--hold-ms``, the time for which a press that was accepted moves.
VALID_S: Final = 1.0


@click.command()
@click.argument("robot", required=False)
@click.option("--axes", is_flag=True, help="Begin with the axes instead of the tip.")
@click.option("--speed", type=NumberRange(0.01, 1000.0), help="First speed of the tip [mm/s]; default 10.")
@click.option(
    "--hold-ms",
    default=150.0,
    show_default=True,
    type=NumberRange(20.0, 1000.0),
    help="Time that one key press moves [ms]; without another the robot holds.",
)
@click.option(
    "--gamepad",
    is_flag=False,
    flag_value="",
    metavar="[DEVICE]",
    help="Move by the only gamepad or 3D mouse, or by that of /dev/input/...",
)
@click.option(
    "--mapping",
    type=click.Path(path_type=Path, dir_okay=False),
    help="What its buttons and axes do (YAML); default: docs/jogging.md.",
)
@click.option("--takeover", is_flag=True, help="Take the lease from its holder; the robots hold.")
@socket_option
def command(
    robot: str | None,
    axes: bool,
    speed: float | None,
    hold_ms: float,
    gamepad: str | None,
    mapping: Path | None,
    takeover: bool,
    socket: str | None,
) -> None:
    """Move ROBOT of a running daemon by the arrow keys or WASD; space stops, q quits.

    A key that is held repeats and moves steadily; released, the robot holds after --hold-ms. Tab changes
    between tip and axes, 1 to 9 choose an axis, + and - change the speed.

    With --gamepad the sticks move while the dead-man button is held (left shoulder); B is an estop.
    """
    from contid.client import Client
    from contid_hands.teleop.jog_session import HELP, Console, JogOptions, JogSession
    from contid_hands.teleop.keys import Keyboard
    from contid_hands.teleop.status_line import StatusLine

    line = StatusLine(sys.stdout)
    options = JogOptions(robot, hold_ms / 1e3, speed, axes)
    if gamepad is None:
        if mapping is not None:
            raise click.BadParameter("maps a gamepad; give --gamepad too", param_hint="--mapping")
        with Client(socket, name="contid jog", valid_s=VALID_S) as client, line, Keyboard() as keyboard:
            session = JogSession(client, Console(keyboard, line.log, line.show), options)
            line.log(HELP)
            session.run(takeover)
        return
    from contid_hands.teleop.gamepad.find import choose_device
    from contid_hands.teleop.gamepad.mapping import default_mapping, read_mapping
    from contid_hands.teleop.gamepad.pad import Gamepad
    from contid_hands.teleop.gamepad.session import GamepadSession

    with choose_device(gamepad) as device:
        # A device that is named and is of no kind gets the mapping of gamepads.
        file = mapping or default_mapping(device.has.kind)
        pad = Gamepad(device, read_mapping(file, device.has))
        with Client(socket, name="contid jog", valid_s=VALID_S) as client, line, Keyboard() as keyboard:
            session = GamepadSession(client, Console(keyboard, line.log, line.show), options, pad)
            line.log(f"{device.has.name} ({device.path}): {pad.mapping.help}")
            session.run(takeover)
