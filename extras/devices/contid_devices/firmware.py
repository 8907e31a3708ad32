"""``contid firmware``: build, flash and inspect the sketch of the Arduino Due boards."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, cast

import click

from contid.cli.support.parameters import robot_names
from contid.errors import ContidError

#: Modules of the driver, found by name like every driver: sources and the emulator; builds for a Cortex-M3.
_SOURCES: Final = "contid_devices.due.firmware_build"
_CORTEX: Final = "contid_devices.due.cortex"
#: Name of the board for arduino-cli (fully qualified board name), by the USB socket.
_BOARD_NAMES: Final = {"native": "arduino:sam:arduino_due_x", "programming": "arduino:sam:arduino_due_x_dbg"}


@click.group()
def command() -> None:
    """The sketch of the Arduino Due boards."""


@command.command()
def build() -> None:
    """Build the core here: the emulator, and as Cortex-M3 code with its size.

    The sketch itself is built by the Arduino IDE or arduino-cli; this finds compile errors early and prints
    the share of the board's memory.
    """
    sources, cortex = import_module(_SOURCES), import_module(_CORTEX)
    click.echo(f"sources: {sources.firmware_dir()}")
    click.echo(f"emulator: {sources.build_host()}")
    if find_spec("ziglang") is None:
        click.echo("Cortex-M3: not built: it needs the package ziglang (pip install ziglang)", err=True)
        return
    core_flash, core_ram = cortex.memory_use(cortex.build_core())
    flash, ram = core_flash + cortex.ARDUINO_FLASH, core_ram + cortex.ARDUINO_RAM
    click.echo(
        f"Cortex-M3: core {core_flash} B flash, {core_ram} B RAM; with the Arduino core about "
        f"{flash / cortex.FLASH_BYTES:.0%} of {cortex.FLASH_BYTES // 1024} KB flash and "
        f"{ram / cortex.RAM_BYTES:.0%} of {cortex.RAM_BYTES // 1024} KB RAM (estimates)"
    )


@command.command()
@click.argument("port")
@click.option(
    "--connection",
    type=click.Choice(["native", "programming"]),
    default="programming",
    show_default=True,
    help="Which of the board's two USB sockets PORT is.",
)
@click.option(
    "--binary",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Flash this .bin with bossac.",
)
@click.option("--dry-run", is_flag=True, help="Print the commands, run nothing.")
def flash(port: str, connection: str, binary: Path | None, dry_run: bool) -> None:
    """Flash the sketch to the board at PORT, with arduino-cli, or with bossac and a .bin.

    Without either tool the exact commands are printed. The board stops driving while it is flashed.
    """
    steps = _bossac_steps(port, connection, binary) if binary else _arduino_steps(port, connection)
    tool = "bossac" if binary else "arduino-cli"
    if dry_run or shutil.which(tool) is None:
        for step in steps:
            click.echo(shlex.join(step))
        if not dry_run:
            raise ContidError(f"{tool} is not installed; run the commands above where it is")
        return
    for step in steps:
        click.echo(shlex.join(step), err=True)
        if subprocess.run(step, check=False).returncode != 0:
            raise ContidError(f"failed: {shlex.join(step)}")


def _arduino_steps(port: str, connection: str) -> list[list[str]]:
    """Commands that build the sketch, marked with its sources, and upload it."""
    sources = import_module(_SOURCES)
    sketch, board = str(sources.firmware_dir() / "contid_due"), _BOARD_NAMES[connection]
    mark = f"compiler.cpp.extra_flags=-DCONTID_BUILD_ID={sources.build_id()}u"
    return [
        ["arduino-cli", "core", "install", "arduino:sam"],
        ["arduino-cli", "compile", "--fqbn", board, "--build-property", mark, sketch],
        ["arduino-cli", "upload", "--fqbn", board, "--port", port, sketch],
    ]


def _bossac_steps(port: str, connection: str, binary: Path) -> list[list[str]]:
    """Commands that erase the flash and write a binary, as the Arduino core has them (its platform.txt)."""
    # Opening either port at 1200 baud erases the flash and starts the boot loader.
    name, native = Path(port).resolve().name, "true" if connection == "native" else "false"
    return [
        ["stty", "-F", port, "1200"],
        ["sleep", "1"],
        ["bossac", f"--port={name}", "-U", native, "-e", "-w", "-v", "-b", str(binary), "-R"],
    ]


@command.command()
@click.argument("robot_file", required=False, shell_complete=robot_names)
def info(robot_file: str | None) -> None:
    """Version of the sketch, and the hello of the boards of ROBOT_FILE."""
    sources = import_module(_SOURCES)
    codes = import_module("contid_drivers.due.codes")
    click.echo(f"sources: {sources.firmware_dir()}")
    click.echo(f"protocol version: {codes.PROTOCOL_VERSION}")
    click.echo(f"protocol: {sources.firmware_dir() / 'PROTOCOL.md'}")
    if robot_file is None:
        return
    from contid.control.engine.wiring import wired_buses
    from contid.robot_file.load import load_named

    boards = [bus for bus in wired_buses(load_named(robot_file)) if bus.wiring.driver == "due"]
    if not boards:
        raise ContidError(f"{robot_file}: no bus has driver 'due'")
    hello = import_module("contid_drivers.due.session").ask_hello
    for bus in boards:
        name, options = bus.wiring.name, cast(Any, bus.wiring.options)
        found = hello(name, options)
        version = ".".join(map(str, found.firmware))
        click.echo(
            f"{name}: {options.port}: role {found.role_name}, firmware {version} "
            f"({sources.build_note(found.build_id)}), chip {found.unique_id}, "
            f"booted {found.boot} times, last by {found.cause.message}, up for {found.uptime_ms / 1000:.1f} s"
        )
        if found.position_lost:
            click.echo(f"{name}: position lost: no motor without homing is armed before contid home --parked")
        click.echo(f"{name}: pins {found.pins}")
