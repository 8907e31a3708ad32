"""What a bring-up leaves: the section ``bringup:`` of the robot file, and one page of HTML."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from contid.hal.pulses import ProvenDevice
from contid.robot_file.edit import Change, set_values
from contid.robot_file.load import LoadedFile, load_robot_file
from contid.whole_file import replacing
from contid_bringup.drive_fit import DriveFit


class ProvenAxis(NamedTuple):
    """What a bring-up found about one axis.

    Attributes:
        axis: ``ROBOT.AXIS``.
        name: ``ok``, or the name of what is wrong.
        device: the board or servo.
        wiring: digest of the keys that depend on its cables and parts.
        lines: the findings as they were printed.
        fit: numbers of a motor; None without.
    """

    axis: str
    name: str
    device: ProvenDevice
    wiring: str
    lines: Sequence[str]
    fit: DriveFit | None = None


def write_section(path: Path, records: Sequence[ProvenAxis], when: datetime) -> None:
    """Write the axes into ``bringup:`` of the robot file; those of other bring-ups stay, newest ones too.

    Raises:
        ContidError: the file cannot be written.
    """
    section: dict[str, Mapping[str, str | float]] = {
        name: each.model_dump(exclude_none=True) for name, each in load_robot_file(path).file.bringup.items()
    }
    section |= {record.axis: _entry(record, when) for record in records}
    set_values(path, [Change("bringup", section)])
    load_robot_file(path)


def _entry(record: ProvenAxis, when: datetime) -> Mapping[str, str | float]:
    entry: dict[str, str | float] = {
        "date": f"{when:%Y-%m-%d %H:%M}",
        "verdict": record.name,
        "wiring": record.wiring,
        "device": record.device.identity,
        "firmware": record.device.firmware,
    }
    if record.fit is not None:
        for key, estimate, scale in (
            ("friction_percent", record.fit.friction, 100.0),
            ("no_load_deg_s", record.fit.no_load_deg_s, 1.0),
            ("time_constant_ms", record.fit.time_constant_s, 1000.0),
        ):
            if estimate.certain:
                entry[key] = float(f"{estimate.value * scale:.4g}")
    return entry


_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Bring-up of {name}</title>
<style>
body {{ font: 11pt sans-serif; margin: 2cm auto; max-width: 19cm }}
table {{ border-collapse: collapse; width: 100% }}
td, th {{ border: 1px solid #999; padding: 4px 8px; text-align: left; vertical-align: top }}
.ok {{ color: #060 }} .bad {{ color: #a00; font-weight: bold }}
@media print {{ body {{ margin: 0 }} }}
</style>
<h1>Bring-up of {name}</h1>
<p>{when}; robot file {file}; contid {version}.</p>
<table><tr><th>axis</th><th>result</th><th>device, firmware</th><th>wiring</th><th>findings</th></tr>
{rows}
</table>
<p>Examined by: ______________________</p>
<p>Watchdog and emergency stop tried by pulling them: ______________________</p>
</html>
"""


def write_page(
    page: Path, path: Path, loaded: LoadedFile, records: Sequence[ProvenAxis], when: datetime
) -> None:
    """Write the record as one page that a browser prints.

    Raises:
        ContidError: the file cannot be written.
    """
    from contid import __version__

    rows = "\n".join(
        "<tr>"
        + "".join(
            f"<td{kind}>{text}</td>"
            for kind, text in (
                ("", html.escape(record.axis)),
                (f' class="{"ok" if record.name == "ok" else "bad"}"', html.escape(record.name)),
                ("", html.escape(f"{record.device.identity}, {record.device.firmware}")),
                ("", record.wiring),
                ("", "<br>".join(map(html.escape, record.lines))),
            )
        )
        + "</tr>"
        for record in records
    )
    text = _PAGE.format(
        name=html.escape(loaded.file.name),
        when=f"{when:%Y-%m-%d %H:%M}",
        file=html.escape(str(path)),
        version=__version__,
        rows=rows,
    )
    with replacing(page) as file:
        file.write(text.encode(errors="backslashreplace"))  # names of files need not be UTF-8
