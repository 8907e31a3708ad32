"""``contid fault``: the table of faults, or one of them; the documentation's pages of faults and states."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from contid.control.tick.faults import PAGES, Fault, markdown
from contid.control.tick.supervisor import MOVES, Event, Mode

_MADE: Final = "<!-- Made by `contid fault --write docs`; a test compares it with the code. -->"

#: What a state means, for a person.
MEANING: Final[dict[Mode, str]] = {
    Mode.OFF: "nothing is commanded; the devices are in the rest their last stop left them in",
    Mode.CONNECTING: "waiting for a first valid sample of every axis",
    Mode.READY: "every axis was read; nothing was commanded, torque was not touched",
    Mode.ARMING: "goal := present position, then torque on",
    Mode.APPROACH: "on the jerk-limited way to a target",
    Mode.RUN: "following the targets, tick by tick",
    Mode.HOLD: "staying at the last command, armed",
    Mode.STOPPING: "on the way to the rest of a stop policy",
    Mode.FAULT: "stopped by stop.on_fault; latched until clear-fault",
}


def name_of(fault: Fault) -> str:
    """As in every message: ``device-lost``."""
    return fault.name.lower().replace("_", "-")


def fault_page(fault: Fault) -> str:
    """One fault."""
    page = PAGES[fault]
    return "\n".join(
        [
            f"# Fault {int(fault)}: {name_of(fault)}",
            _MADE,
            "",
            f"**Cause.** {_sentence(page.cause)}",
            "",
            f"**What the robot did.** {_sentence(page.reaction)}",
            "",
            f"**What to do.** {_sentence(page.remedy)}",
            "",
            "The fault is latched: `contid clear-fault` looks at every axis again and leaves the robot in",
            "READY without moving it; `contid resume` arms it. `stop` and `estop` bring its devices to rest",
            "and do not clear it.",
            "",
            "[All faults](../faults.md)",
            "",
        ]
    )


def states_page() -> str:
    """The states and every move between them."""
    lines = ["# States of a robot", _MADE, "", "```mermaid", "stateDiagram-v2", "    [*] --> OFF"]
    arrows: dict[tuple[Mode, Mode], list[str]] = {}
    for (start, event), end in MOVES.items():
        if event not in (Event.FAULT, Event.ESTOP):
            arrows.setdefault((start, end), []).append(event.value)
    lines += [
        f"    {start.name} --> {end.name}: {', '.join(events)}" for (start, end), events in arrows.items()
    ]
    lines += [
        "```",
        "",
        "Two moves are left out of the diagram: a fault leads from every state to FAULT, and an emergency",
        "stop from every state but FAULT to OFF. In FAULT both stops bring the devices to rest; the latch",
        "stays.",
        "",
        "Orders between two ticks are carried out one after another, and so is what they ask of the",
        "devices: a `clear-fault` or a `resume` after an `estop` does not replace its rest, and a stop",
        "drops what is to be armed or cleared before it. A later stop that would leave more power does",
        "not replace one that runs. A stop by `hold` in FAULT does nothing to devices that rest: an arm",
        "that vents goes on venting. A fault while a robot is being armed brings its devices to the rest",
        "of `on_fault`; so does the loss of a bus with what the robot has on others. A relax or a vent",
        "that a lost bus did not get is sent when it is back; a later stop by `hold` does not withdraw it.",
        "The answer to a stop that leaves more power than one that goes on names that (`stronger`).",
        "",
        "| state | number | meaning | what can happen |",
        "|---|---|---|---|",
    ]
    for mode in Mode:
        possible = [f"{e.value} -> {MOVES[(mode, e)].name}" for e in Event if (mode, e) in MOVES]
        lines.append(f"| {mode.name} | {int(mode)} | {MEANING[mode]} | {', '.join(possible)} |")
    return "\n".join(lines) + "\n"


def pages() -> dict[str, str]:
    """Every page by its path below ``docs``."""
    faults = {f"faults/{int(fault)}.md": fault_page(fault) for fault in PAGES}
    return {**faults, "faults.md": markdown(), "states.md": states_page()}


def write_pages(folder: Path) -> list[Path]:
    """Write every page below a folder."""
    written = []
    for name, text in pages().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return written


def _sentence(message: str) -> str:
    return message[0].upper() + message[1:] + "."


@click.command()
@click.argument("number", required=False, type=int)
@click.option(
    "--write", type=click.Path(file_okay=False), help="Write the pages of faults and states below a folder."
)
def command(number: int | None, write: str | None) -> None:
    """Print cause, reaction and remedy of a fault; without NUMBER, the table of all."""
    if write is not None:
        if number is not None:
            raise click.UsageError("--write writes the pages of all faults: leave NUMBER out")
        for path in write_pages(Path(write)):
            click.echo(path, err=True)
        return
    by_number = {int(fault): fault for fault in PAGES}
    if number is None:
        click.echo(markdown(), nl=False)
    elif number in by_number:
        click.echo(fault_page(by_number[number]), nl=False)
    else:
        raise click.BadParameter(f"no fault {number}; there are {', '.join(map(str, by_number))}")
