"""The emulated hand, its left finger with limited currents and a reaction to contacts."""

from __future__ import annotations

from pathlib import Path

from contid_emulate.dynamixel.motion import FRICTION_MA


def hand(folder: Path, configs: Path, policy: str) -> str:
    """The emulated hand, its left finger with limited currents and a policy."""
    text = (configs / "hand.emulated.yaml").read_text().replace("./hand.tty", str(folder / "hand.tty"))
    # A busy machine may keep the loop or the emulator waiting.
    text = text.replace("rate_hz: 200", "rate_hz: 100", 1).replace(
        "tolerance_ticks: 10", "tolerance_ticks: 100"
    )
    text = text.replace(
        "    baud: 1000000\n", "    baud: 1000000\n    usb_latency_ms: 15\n    watchdog_ms: 2000\n"
    )
    for device in (1, 2):
        text = text.replace(
            f"id: {device},", f"id: {device}, mode: current_based_position, goal_current_ma: 400,"
        )
    sense = f"    sense: {{contact: {policy}, usual_ma: {FRICTION_MA + 20:.0f}, contact_ma: 100}}\n"
    text = text.replace("    rest_mm: [60, 60]\n", "    rest_mm: [60, 60]\n" + sense, 1)
    (folder / "hand.yaml").write_text(text)
    return text
