"""``contid servo``: numbers, baud rate, registers and restart of one servo; numbering of a whole robot."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

import click

from contid.cli.support.parameters import robot_names
from contid.errors import ContidError

if TYPE_CHECKING:
    from contid.hal import Commissions


@dataclasses.dataclass(frozen=True, slots=True)
class ServoPortOptions:
    """The driver and the port given before the sub-command."""

    driver: Commissions
    port: str | None
    baud: int

    @property
    def port_and_baud(self) -> tuple[str, int]:
        """Serial port and its baud rate.

        Raises:
            click.UsageError: no port was given.
        """
        if self.port is None:
            raise click.UsageError("give the serial port: contid servo --port PORT ...")
        return self.port, self.baud


class _Servos(click.Group):
    """The sub-commands, and the name of a robot file in place of one: ``contid servo ROBOT``."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        from contid.robot_file.load import find_robot_file

        if args[0] not in self.commands:
            with suppress(ContidError, OSError):
                find_robot_file(args[0])
                return "watch", self.commands["watch"], args
        return super().resolve_command(ctx, args)


@click.group(cls=_Servos)
@click.option("--port", help="Serial port the servo is on.")
@click.option(
    "--baud",
    type=click.IntRange(1),
    default=1000000,
    show_default=True,
    help="Baud rate the servo has now.",
)
@click.option("--driver", default="dynamixel", show_default=True)
@click.pass_context
def command(context: click.Context, port: str | None, baud: int, driver: str) -> None:
    """Commission servos; connect a servo alone when its id may be taken.

    `contid servo ROBOT.yaml` shows position, current, supply and temperature of its axes.
    """
    from contid.hal import Commissions, find_tool, load_driver

    tool = find_tool(driver, load_driver(driver), Commissions)  # type: ignore[type-abstract]  # a runtime protocol
    if tool is None:
        raise ContidError(f"driver {driver!r} has no servos to commission")
    context.obj = ServoPortOptions(tool, port, baud)


def _on_device(name: str) -> Callable[[Callable[..., None]], click.Command]:
    """The command ``contid servo NAME DEVICE``; the function gets the port, the id, and what it declares."""

    def decorate(function: Callable[..., None]) -> click.Command:
        given = click.argument("device", type=int)(click.pass_obj(function))
        return command.command(name)(given)

    return decorate


@command.command("setup")
@click.argument("robot_file", shell_complete=robot_names)
@click.pass_obj
def setup(servo_port: ServoPortOptions, robot_file: str) -> None:
    """Ask for one servo of ROBOT_FILE after the other and give each its id and baud rate."""
    from contid.control.engine.wiring import wired_buses
    from contid.hal import Commissions
    from contid.robot_file.load import load_named

    buses = wired_buses(load_named(robot_file))
    tools = [bus.tool(Commissions) for bus in buses]  # type: ignore[type-abstract]
    if not any(tools):
        raise ContidError(f"{robot_file} has no servos to number")
    for bus, tool in zip(buses, tools, strict=True):
        if tool is not None:
            tool.setup(bus.wiring.name, bus.wiring.options, bus.axes, _ask, click.echo)
    click.echo(f"every servo is numbered; next: contid doctor {robot_file}")


@command.command("watch")
@click.argument("robot_file", shell_complete=robot_names)
@click.option("--once", is_flag=True, help="Print one table; so it is where stdout is no terminal.")
def watch(robot_file: str, once: bool) -> None:
    """Show the axes of ROBOT_FILE as they are, until Ctrl-C; nothing moves, torque stays as it is."""
    from contid.control.engine.wiring import wired_buses
    from contid.robot_file.load import load_named
    from contid_devices.live_axes import show

    show(wired_buses(load_named(robot_file)), once)


def _ask(request: str) -> None:
    """Show a request and wait for Enter; the end of stdin ends the command."""
    click.prompt(f"{request}, then press Enter", default="", show_default=False, prompt_suffix=" ")


@_on_device("set-id")
@click.argument("new", type=int)
def set_id(servo_port: ServoPortOptions, device: int, new: int) -> None:
    """Change the id DEVICE to NEW."""
    servo_port.driver.set_id(*servo_port.port_and_baud, device, new)
    click.echo(f"id {device} is id {new} now")


@_on_device("set-baud")
@click.argument("new", type=int)
def set_baud(servo_port: ServoPortOptions, device: int, new: int) -> None:
    """Change the baud rate of id DEVICE to NEW."""
    servo_port.driver.set_baud(*servo_port.port_and_baud, device, new)
    click.echo(f"id {device} has {new} baud now")


@_on_device("blink")
@click.option("--times", default=8, show_default=True)
def blink(servo_port: ServoPortOptions, device: int, times: int) -> None:
    """Let the LED of id DEVICE blink, to find it."""
    servo_port.driver.blink(*servo_port.port_and_baud, device, times)


@_on_device("read")
@click.argument("registers", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="One JSON object per register.")
def read(servo_port: ServoPortOptions, device: int, registers: tuple[str, ...], as_json: bool) -> None:
    """Print REGISTERS of id DEVICE by name or address, every one by default."""
    for each in servo_port.driver.read_registers(*servo_port.port_and_baud, device, registers):
        if as_json:
            click.echo(json.dumps(dataclasses.asdict(each)))
        else:
            click.echo(f"{each.address:4}  {each.name:28} {each.value:11}  {each.unit}".rstrip())


@_on_device("write")
@click.argument("register")
@click.argument("value", type=int)
def write(servo_port: ServoPortOptions, device: int, register: str, value: int) -> None:
    """Set REGISTER (name or address) of id DEVICE to VALUE; goals and torque are refused."""
    after = servo_port.driver.write_register(*servo_port.port_and_baud, device, register, value)
    click.echo(f"{register} is {after} now")


@_on_device("reboot")
def reboot(servo_port: ServoPortOptions, device: int) -> None:
    """Restart id DEVICE: torque off, hardware errors cleared, turn count lost."""
    servo_port.driver.reboot(*servo_port.port_and_baud, device)
    click.echo(f"id {device} restarted; its torque is off and its turn count gone")


@_on_device("reset")
@click.confirmation_option(prompt="Factory values for every setting but id and baud rate?")
def reset(servo_port: ServoPortOptions, device: int) -> None:
    """Give id DEVICE its factory settings; id and baud rate stay."""
    servo_port.driver.factory_reset(*servo_port.port_and_baud, device)
    click.echo(f"id {device} has its factory settings; id and baud rate stayed")
