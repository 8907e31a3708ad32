"""``contid servo``: id, baud rate and restart of one servo."""

from __future__ import annotations

import click

from contid.errors import ContidError
from contid.hal import Commissions, load_driver


@click.group()
@click.option("--port", required=True, help="Serial port the servo is on.")
@click.option("--baud", default=1000000, show_default=True, help="Rate it has now.")
@click.option("--driver", default="dynamixel", show_default=True)
@click.pass_context
def command(context: click.Context, port: str, baud: int, driver: str) -> None:
    """Commission one servo; connect it alone when its id may be taken."""
    found = load_driver(driver)
    if not isinstance(found, Commissions):
        raise ContidError(f"driver {driver!r} has no servos to commission")
    context.obj = (found, port, baud)


@command.command("set-id")
@click.argument("device", type=int)
@click.argument("new", type=int)
@click.pass_obj
def set_id(target: tuple[Commissions, str, int], device: int, new: int) -> None:
    """Change the id DEVICE to NEW."""
    driver, port, baud = target
    driver.set_id(port, baud, device, new)
    click.echo(f"id {device} is id {new} now")


@command.command("set-baud")
@click.argument("device", type=int)
@click.argument("new", type=int)
@click.pass_obj
def set_baud(target: tuple[Commissions, str, int], device: int, new: int) -> None:
    """Change the baud rate of id DEVICE to NEW."""
    driver, port, baud = target
    driver.set_baud(port, baud, device, new)
    click.echo(f"id {device} has {new} baud now")


@command.command("reboot")
@click.argument("device", type=int)
@click.pass_obj
def reboot(target: tuple[Commissions, str, int], device: int) -> None:
    """Restart id DEVICE: torque off, hardware errors cleared, turn count lost."""
    driver, port, baud = target
    driver.reboot(port, baud, device)
    click.echo(f"id {device} restarted; its torque is off and its turn count gone")
