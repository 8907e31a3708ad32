"""``contid scan``: devices on the serial ports."""

from __future__ import annotations

import dataclasses
import json

import click

from contid.cli.support.usb_ports import find_by_unplugging
from contid.errors import ContidError
from contid.hal import Scans, driver_names, load_driver


@click.command()
@click.argument("ports", nargs=-1)
@click.option("--baud", "bauds", type=int, multiple=True, help="Only these rates; default: every one.")
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
        driver = load_driver(name)
        if not isinstance(driver, Scans):
            continue
        if ports and not left:
            break
        for found in driver.scan(left, bauds, lambda line: click.echo(line, err=True)):
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
