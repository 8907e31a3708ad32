"""Event streams of gamepads: dead-man button, lost events, unplugging; the codes of the kernel's headers."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from contid.errors import DeviceLostError
from contid_hands.teleop.gamepad.device import AbsInfo, Capabilities, InputDevice, open_device, request_number
from contid_hands.teleop.gamepad.events import ABSOLUTE, BUTTONS, EVENT, RELATIVE
from contid_hands.teleop.gamepad.mapping import default_mapping, read_mapping
from contid_hands.teleop.gamepad.pad import Gamepad
from tests.support import pads
from tests.support.pads import ABS_RY, ABS_X, ABS_Y, BTN_EAST, BTN_START, BTN_TL, XBOX, Recording, recorded
from tests.support.waiting import until

pytestmark = pytest.mark.process


def gamepad(device: InputDevice, mapping: Path | None = None) -> Gamepad:
    return Gamepad(device, read_mapping(mapping or default_mapping(device.has.kind), device.has))


@pytest.fixture
def pad() -> Iterator[tuple[Recording, Gamepad]]:
    with recorded() as (recording, device):
        yield recording, gamepad(device)


def shares(pad: Gamepad, now_s: float = 0.0) -> list[float]:
    return [pad.share(each, now_s) for each in pad.mapping.tip]


def test_codes_and_requests_are_those_of_the_kernel(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None or not Path("/usr/include/linux/input.h").exists():
        pytest.skip("needs a C compiler and the headers of the kernel")
    constants = {**ABSOLUTE, **RELATIVE, **BUTTONS, "sizeof(struct input_event)": EVENT.size}
    constants |= {
        "EVIOCGID": request_number(0x02, 8), "EVIOCGNAME(256)": request_number(0x06, 256),
        "EVIOCGKEY(96)": request_number(0x18, 96), "EVIOCGBIT(EV_ABS, 8)": request_number(0x23, 8),
        "EVIOCGABS(ABS_RX)": request_number(0x43, 24), "KEY_MAX / 8 + 1": 96, "BUS_USB": 3,
    }  # fmt: skip
    lines = "\n".join(f'printf("%lu\\n", (unsigned long)({name}));' for name in constants)
    source = tmp_path / "codes.c"
    source.write_text(f"#include <stdio.h>\n#include <linux/input.h>\nint main(void) {{\n{lines}\n}}\n")
    program = tmp_path / "codes"
    subprocess.run([compiler, "-o", str(program), str(source)], check=True, timeout=60)
    printed = subprocess.run([program], capture_output=True, text=True, check=True, timeout=60).stdout
    assert dict(zip(constants, map(int, printed.split()), strict=True)) == constants


def test_sticks_count_under_the_dead_man_button_only(pad: tuple[Recording, Gamepad]) -> None:
    recording, read = pad
    assert not read.poll(0.0).held
    recording.button(BTN_TL, 1)
    assert read.poll(0.0).held
    recording.axis(ABS_X, 32767)
    recording.axis(ABS_Y, -32768)
    recording.axis(ABS_RY, 4000)  # within the dead-band
    assert read.poll(0.0).held
    assert shares(read) == pytest.approx([1.0, 1.0, 0.0])
    recording.axis(ABS_X, -16384)
    read.poll(0.0)
    assert shares(read)[0] == pytest.approx(-(0.5 - 0.15) / 0.85, abs=1e-3)
    recording.button(BTN_TL, 0)
    assert not read.poll(0.0).held


def test_a_release_between_two_polls_is_not_lost(pad: tuple[Recording, Gamepad]) -> None:
    recording, read = pad
    recording.button(BTN_TL, 1)
    assert read.poll(0.0).held
    recording.button(BTN_TL, 0)
    recording.button(BTN_TL, 1)
    assert not read.poll(0.0).held
    recording.axis(ABS_X, 32767)
    recording.button(BTN_TL, 0)
    recording.button(BTN_TL, 1)
    for _ in range(3):  # pressed while deflected: not before the stick was centred and it is pressed again
        assert not read.poll(0.0).held
    recording.axis(ABS_X, 0)
    assert not read.poll(0.0).held
    recording.button(BTN_TL, 0)
    recording.button(BTN_TL, 1)
    assert not read.poll(0.0).held  # the release was in between
    assert read.poll(0.0).held


def test_a_device_that_is_deflected_or_pressed_at_the_start_moves_nothing_until_released() -> None:
    deflected = {**XBOX.absolute, ABS_X: AbsInfo(30000, -32768, 32767, 16, 128)}
    with recorded(replace(XBOX, absolute=deflected, pressed=frozenset({BTN_TL}))) as (recording, device):
        read = gamepad(device)
        recording.axis(ABS_X, 30001)
        recording.button(BTN_TL, 2)  # a repetition of the kernel is no press
        assert not read.poll(0.0).held
        recording.button(BTN_TL, 0)
        recording.button(BTN_TL, 1)
        read.poll(0.0)
        assert not read.poll(0.0).held
        recording.axis(ABS_X, 12)
        recording.button(BTN_TL, 0)
        read.poll(0.0)
        recording.button(BTN_TL, 1)
        assert read.poll(0.0).held


def test_cut_events_count_when_they_are_whole(pad: tuple[Recording, Gamepad]) -> None:
    recording, read = pad
    wire = pads.event(pads.KEY, BTN_TL, 1) + pads.REPORT
    for cut in (wire[:7], wire[7:30], wire[30:47]):
        recording.write(cut)
        assert not read.poll(0.0).held
    recording.write(wire[47:])
    assert read.poll(0.0).held


def test_lost_events_release_and_a_lost_stop_is_found() -> None:
    class Kernel(InputDevice):
        """Has the state after the loss, as EVIOCGKEY gives it."""

        after = XBOX

        def present(self) -> Capabilities:
            return self.after

    with recorded() as (recording, device):
        kernel = Kernel(device._descriptor, device.path, device.has)
        read = gamepad(kernel)
        recording.button(BTN_TL, 1)
        assert read.poll(0.0).held
        kernel.after = replace(XBOX, pressed=frozenset({BTN_TL, BTN_EAST}))
        recording.write(pads.DROPPED + pads.event(pads.ABS, ABS_X, 32767) + pads.event(pads.KEY, BTN_TL, 1))
        assert not read.poll(0.0).held
        recording.write(pads.REPORT)
        assert read.poll(0.0).orders == ("estop",)
        assert shares(read) == [0.0, 0.0, 0.0]
        assert not read.poll(0.0).held


def test_orders_count_without_the_dead_man_button(pad: tuple[Recording, Gamepad]) -> None:
    recording, read = pad
    recording.button(BTN_START, 1)
    recording.button(BTN_START, 0)
    recording.button(BTN_EAST, 1)
    assert read.poll(0.0).orders == ("resume", "estop")
    assert read.poll(0.0).orders == ()


def test_an_unplugged_device_is_an_error_and_nothing_is_held(pad: tuple[Recording, Gamepad]) -> None:
    recording, read = pad
    recording.button(BTN_TL, 1)
    recording.axis(ABS_X, 32767)
    assert read.poll(0.0).held
    recording.button(BTN_TL, 1)
    recording.unplug()
    with pytest.raises(DeviceLostError, match=r"Microsoft X-Box 360 pad \(/dev/input/event7\): is gone"):
        read.poll(0.0)


def test_a_silent_device_releases_when_the_mapping_has_a_time(tmp_path: Path) -> None:
    text = default_mapping("gamepad").read_text(encoding="utf-8")
    (tmp_path / "pad.yaml").write_text(text + "silence_s: 0.5\n")
    with recorded() as (recording, device):
        read = gamepad(device, tmp_path / "pad.yaml")
        recording.button(BTN_TL, 1)
        assert read.poll(10.0).held
        assert read.poll(60.0).held  # centred: there is nothing to send
        recording.axis(ABS_X, 32767)
        assert read.poll(60.0).held
        assert read.poll(60.4).held
        assert not read.poll(60.6).held
        assert not read.poll(60.7).held


def test_a_3d_mouse_is_centred_when_it_sends_nothing() -> None:
    with recorded(pads.SPACENAVIGATOR) as (recording, device):
        assert device.has.kind == "spacemouse"
        read = gamepad(device)
        recording.button(0x100, 1)
        assert read.poll(0.0).held
        recording.axis(0, 350, pads.REL)
        recording.axis(2, -350, pads.REL)
        assert read.poll(1.0).held
        assert shares(read, 1.0) == pytest.approx([1.0, 0.0, 1.0])
        assert shares(read, 1.2) == [0.0, 0.0, 0.0]
        assert read.poll(1.2).held


def test_a_device_of_the_kernel() -> None:
    """Written with evdev to uinput; the only test that needs a kernel with it."""
    if not os.access("/dev/uinput", os.W_OK):
        pytest.skip("this kernel has no /dev/uinput, or it cannot be written")
    evdev = pytest.importorskip("evdev")
    axes = [(code, evdev.AbsInfo(*info)) for code, info in XBOX.absolute.items()]
    virtual = evdev.UInput({pads.KEY: sorted(XBOX.keys), pads.ABS: axes}, name="contid test pad")
    try:
        until(lambda: os.access(virtual.device.path, os.R_OK), "the device can be read")
        with open_device(virtual.device.path) as device:
            assert device.has.name == "contid test pad"
            assert device.has.absolute[ABS_X][1:5] == XBOX.absolute[ABS_X][1:5]
            read = gamepad(device)
            for kind, code, value in ((pads.KEY, BTN_TL, 1), (pads.ABS, ABS_X, 32767)):
                virtual.write(kind, code, value)
                virtual.syn()
            until(lambda: read.poll(0.0).held and shares(read)[0] == 1.0, "the stick is deflected")
            virtual.close()
            with pytest.raises(DeviceLostError):
                until(lambda: not read.poll(0.0), "it is gone")
    finally:
        virtual.close()
