"""Draw docs/images/due-*.svg, schematics of docs/devices/due.md: ``python -m docs.drawings.wiring``."""

from __future__ import annotations

from docs.drawings.svg import Svg, write_drawings

LINE = 16
WIRE = "#1b4965"


class Drawing(Svg):
    """Boxes, wires and notes on a grid of pixels."""

    def __init__(self, title: str, width: int, height: int) -> None:
        super().__init__(title, width, height)
        self.note((16, 24), title, bold=True)

    def box(self, x: int, y: int, width: int, *lines: str) -> None:
        """A part with its lines of text; the first is its name."""
        height = LINE * len(lines) + 12
        self.add(
            f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="4" fill="#f1f5f8" stroke="black"/>'
        )
        for i, text in enumerate(lines):
            self.note((x + 8, y + LINE * (i + 1) + 2), text, bold=i == 0)

    def wire(self, *points: tuple[int, int], label: str = "") -> None:
        """A line through points; the label stands above its first piece."""
        self.polyline(points, WIRE, 1.5)
        if label:
            self.note((min(points[0][0], points[1][0]) + 6, points[0][1] - 4), label)


def motor_channel() -> Drawing:
    """One channel of a motor board, with supply and emergency stop."""
    d = Drawing("Motor board, channel m0; the other channels alike, pins in the table", 900, 486)
    d.box(
        16,
        60,
        150,
        "Arduino Due",
        "",
        "D9   PWM",
        "D38  input a",
        "D39  input b",
        "",
        "D22  bridge fault",
        "",
        "A0   current",
        "",
        "",
        "",
        "D2   encoder A",
        "D13  encoder B",
        "3.3 V, GND",
        "D53 open: motors",
    )
    d.box(
        460,
        60,
        150,
        "H-bridge",
        "",
        "PWM / EN",
        "IN a",
        "IN b",
        "",
        "fault (open drain)",
        "",
        "current sense",
        "logic supply 3.3 V",
    )
    d.wire((166, 102), (460, 102), label="PWM, a, b: 1 kOhm each to 3.3 V (brake)")
    d.wire((166, 118), (460, 118))
    d.wire((166, 134), (460, 134))
    d.wire((166, 166), (460, 166), label="4.7 kOhm to 3.3 V")
    d.wire((166, 198), (460, 198), label="1 kOhm in series, 100 nF to GND")
    d.box(690, 80, 190, "Gear motor", "both leads, 100 nF across")
    d.wire((610, 102), (690, 102), label="OUT 1, 2")
    d.box(690, 240, 190, "Encoder (Hall, 2 tracks)", "supply 3.3 V and GND", "shielded, away from motor")
    d.wire((166, 262), (690, 262), label="A: 4.7 kOhm to 3.3 V, 100 Ohm in series")
    d.wire((166, 278), (690, 278))
    d.note((172, 294), "B: the same. An encoder of 5 V:")
    d.note((172, 310), "a 74LVC245 at 3.3 V between")
    d.box(16, 350, 150, "Motor supply", "as the motor, 12 V", "limited for tests")
    d.box(230, 350, 140, "Fuse, slow", "1.5 x the rated", "current of all")
    d.box(460, 350, 170, "E-stop relay, guided", "make contact: supply", "break contact: feedback")
    d.wire((166, 380), (230, 380))
    d.wire((370, 380), (460, 380))
    d.wire((630, 366), (660, 366), (660, 134), (610, 134), label="")
    d.note((668, 330), "V motor: 1000 uF at the bridges,")
    d.note((668, 346), "TVS diode above the supply")
    d.wire((460, 398), (420, 398), (420, 166))
    d.note(
        (230, 430),
        "Feedback: the opened relay pulls all fault lines to GND, each by a 1N4148 (cathode to relay).",
    )
    d.note(
        (230, 446),
        "The board has a supply of its own: it keeps counting, and reports the fault of its bridges.",
    )
    d.note(
        (230, 462),
        "All GND meet at one point. STBY or nSLEEP of a bridge: to 3.3 V. Coil: through the button.",
    )
    return d


def pressure_channel() -> Drawing:
    """One channel of a pressure board, with air supply and emergency stop."""
    d = Drawing("Pressure board, channel p0; the other channels alike, pins in the table", 900, 440)
    d.box(
        16,
        60,
        150,
        "Arduino Due",
        "",
        "D9   PWM 20 kHz",
        "",
        "",
        "A0   read-back",
        "",
        "GND",
        "",
        "D53 to GND: pressure",
    )
    d.box(
        230,
        60,
        204,
        "Filter, 72 Hz, 2 poles",
        "1 kOhm D9 to GND: 0 bar in reset",
        "10 kOhm, 220 nF to GND",
        "100 kOhm, 22 nF to GND",
    )
    d.wire((166, 102), (230, 102))
    d.box(480, 60, 140, "Amplifier, gain 3", "LM358 at 24 V, 100 nF", "20 kOhm / 10 kOhm", "0 .. 9.9 V")
    d.wire((434, 102), (480, 102))
    d.box(
        700, 60, 180, "Pressure regulator", "command 0-10 V", "read-back out", "supply 24 V", "exhaust free"
    )
    d.wire((620, 102), (700, 102), label="0-10 V")
    d.box(
        230,
        170,
        410,
        "Read-back",
        "0-10 V: 22 kOhm in series, 10 kOhm and 100 nF to GND: 3.125 V at 10 V",
        "4-20 mA: 150 Ohm to GND: 0.6 .. 3.0 V, wire_break_mv: 540",
        "both: 1 kOhm to A0, BAT54S to 3.3 V and GND",
    )
    d.wire((166, 150), (200, 150), (200, 200), (230, 200))
    d.wire((640, 200), (670, 200), (670, 118), (700, 118))
    d.box(16, 300, 140, "Compressed air", "filter, 5 um", "hand valve")
    d.box(190, 300, 150, "Pressure reducer", "a little above ceiling_bar")
    d.box(374, 300, 150, "Dump valve 3/2", "open to exhaust", "without current")
    d.box(558, 300, 150, "Relief valve", "mechanical, above", "ceiling_bar")
    d.box(742, 300, 140, "Regulators", "and chambers")
    for x in (156, 340, 524, 708):
        d.wire((x, 320), (x + 34, 320))
    d.box(374, 380, 334, "24 V, fuse 2 A, E-stop relay", "cuts dump valve and regulators, not the board")
    d.note((16, 398), "All GND meet at one point. Coil of the relay:")
    d.note((16, 414), "through the button. The board: own supply.")
    d.wire((450, 380), (450, 360))
    d.wire((708, 400), (860, 400), (860, 344))
    return d


DRAWINGS = {"due-motor.svg": motor_channel, "due-pressure.svg": pressure_channel}


if __name__ == "__main__":
    write_drawings(DRAWINGS)
