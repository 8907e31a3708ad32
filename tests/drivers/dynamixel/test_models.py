"""The table of models against the vendor's public register lists (`vendor_registers.json`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from contid_drivers.dynamixel import registers as reg
from contid_drivers.dynamixel.exchange.block import INDIRECT_ORDER
from contid_drivers.dynamixel.models import BY_NAME, LAST_FIRMWARE_AT_208, MODELS, ServoModel, model_name
from contid_drivers.dynamixel.options import DynamixelAxisOptions
from contid_drivers.dynamixel.turns import TURNS_MAX, stored_values
from contid_emulate.dynamixel import Servo

VENDOR: dict[str, Any] = json.loads(Path(__file__).with_name("vendor_registers.json").read_text())["models"]
GAINS: dict[str, Any] = json.loads(Path(__file__).with_name("vendor_gains.json").read_text())["models"]
#: Names that differ in the vendor's lists.
ALIASES = {"secondary id": "secondary(shadow) id"}
#: In the manual, but in no list of the vendor.
ONLY_IN_MANUAL = {"startup configuration", "backup ready", "pwm slope"}


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
@pytest.mark.parametrize("firmware", [LAST_FIRMWARE_AT_208, LAST_FIRMWARE_AT_208 + 1])
def test_every_register_is_where_the_vendor_has_it(model: ServoModel, firmware: int) -> None:
    lists = VENDOR[model.name]
    assert lists["number"] == model.number
    before = lists.get("registers_to_firmware_52", lists["registers"])
    vendor = before if firmware <= LAST_FIRMWARE_AT_208 else lists["registers"]
    for register in reg.table_of(model.indirect_data(firmware), model.current_limit, model.gains):
        name = ALIASES.get(register.name, register.name)
        if name == "present current" and model.ma_per_unit is None:
            name = "present load"
        numbered = name.startswith("indirect") and not name.endswith(" 1")
        if name in ONLY_IN_MANUAL or numbered:
            continue
        assert vendor[name] == [register.address, register.size], name
    assert ("goal current" in vendor) is (model.ma_per_unit is not None)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_gains_are_those_of_the_manual_after_power_up_and_after_a_mode_change(model: ServoModel) -> None:
    """`vendor_gains.json` gives the commit of the manual's source for each model."""
    manual = {name: value for name, value in GAINS[model.name].items() if name != "commit"}
    servo = Servo(1, model=model.number)
    gains = {name: servo.by_name[name] for name in manual}
    assert {name: servo.get(register) for name, register in gains.items()} == manual
    for register in gains.values():
        servo.put(register, 77)
    servo.write(reg.OPERATING_MODE.address, bytes((4,)))
    assert {name: servo.get(register) for name, register in gains.items()} == manual


@pytest.mark.parametrize("model", [model for model in MODELS if model.ma_per_unit], ids=lambda m: m.name)
def test_a_whole_number_of_units_survives_the_way_through_milliamperes(model: ServoModel) -> None:
    assert model.ma_per_unit is not None
    for units in range(model.current_limit + 1):
        assert model.to_units(1e3 * (model.ma_per_unit / 1e3) * units) == units
    assert model.to_units(0.999 * model.ma_per_unit) == 0


@pytest.mark.parametrize("name", ["xh540-v150", "xh540-v270"])
def test_current_limits_are_those_of_the_corrected_pages(name: str) -> None:
    """ROBOTIS-GIT/emanual, docs/en at 0bfde4c6 and docs/kr at 036d44f4; pages before them have 2047."""
    assert BY_NAME[name].current_limit == 1188


def test_the_mark_of_the_turns_is_no_gain_of_a_model() -> None:
    marks = {value for turns in range(-TURNS_MAX, TURNS_MAX + 1) for _, value in stored_values(turns)}
    assert not marks & {model.gains.velocity_i for model in MODELS}


def test_the_block_of_the_exchange_leaves_the_marker_of_the_turns_free() -> None:
    assert len(INDIRECT_ORDER) < reg.INDIRECT_COUNT


@pytest.mark.parametrize(
    ("name", "greatest"), [("xm430-w350", 3209), ("xl330-m288", 1750), ("xc330-t288", 910)]
)
def test_a_current_ends_at_the_limit_of_its_model(name: str, greatest: int) -> None:
    options = {"id": 1, "model": name, "goal_current_ma": greatest}
    DynamixelAxisOptions.model_validate(options)
    with pytest.raises(ValidationError, match=f"too much for {name}; allowed: {greatest}"):
        DynamixelAxisOptions.model_validate({**options, "goal_current_ma": greatest + 1})
    model = BY_NAME[name]
    assert model.to_units(greatest) * (model.ma_per_unit or 0.0) <= greatest


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("current_limit_ma", 100),
        ("goal_current_ma", 100),
        ("mode", "current_based_position"),
        ("homing", {"method": "hard_stop", "direction": 1}),
    ],
)
def test_a_model_without_current_registers_takes_no_current(key: str, value: object) -> None:
    with pytest.raises(ValidationError, match=f"{key}.*xl430-w250 has no current registers"):
        DynamixelAxisOptions.model_validate({"id": 1, "model": "xl430-w250", key: value})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ax-12", "AX-12 speaks Protocol 1.0, not supported"),
        ("xw540-t260", "XW540-T260 is not supported"),
        ("xl-320", "XL-320 is not supported"),
    ],
)
def test_other_models_are_refused_by_name(name: str, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        DynamixelAxisOptions.model_validate({"id": 1, "model": name})


def test_a_model_number_has_a_name() -> None:
    assert model_name(1020) == "xm430-w350"
    assert model_name(350) == "xl-320 (not supported)"
    assert model_name(7) == "model 7"
