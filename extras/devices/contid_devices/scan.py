"""``contid scan``: devices on the serial ports, and the port of an adapter, found by unplugging it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import click

from contid.errors import ContidError
from contid.hal import Scans, driver_names, find_tool, load_driver


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


@click.command()
@click.argument("ports", nargs=-1)
@click.option(
    "--baud", "bauds", type=click.IntRange(1), multiple=True, help="Only these rates; default: every one."
)
@click.option("--find-port", is_flag=True, help="Find the port of an adapter by unplugging it.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per device.")
def command(ports: tuple[str, ...], bauds: tuple[int, ...], find_port: bool, as_json: bool) -> None:
    """Ask for devices on PORTS (default: every USB serial port) at every baud rate.

    The usual rates come first; the others only where nothing answered.
    """
    if find_port:
        click.echo(find_by_unplugging(_ask))
        return
    count = 0
    left = list(ports)
    for name in driver_names():
        tool = find_tool(name, load_driver(name), Scans)  # type: ignore[type-abstract]  # a runtime protocol
        if tool is None:
            continue
        if ports and not left:
            break
        for found in tool.scan(left, bauds, lambda line: click.echo(line, err=True)):
            count += 1
            # A port carries devices of one driver.
            left = [port for port in left if port != found.port]
            if as_json:
                click.echo(json.dumps({"driver": name, **dataclasses.asdict(found)}))
            else:
                baud = f"  {found.baud} baud" if found.baud else ""
                where = f"{found.port}{baud}  id {found.address}"
                click.echo(f"{where}  {found.model}  firmware {found.firmware}")
    if not count:
        raise ContidError(
            "no device answered; check power, cabling and adapter, and that no other program uses the port"
        )


def _ask(request: str) -> None:
    click.prompt(f"{request}, then press Enter", default="", show_default=False, prompt_suffix=" ", err=True)
