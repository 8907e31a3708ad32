"""Names of robot files that are none, and the schema without drivers."""

from __future__ import annotations

import jsonschema
import pytest

from contid.errors import ContidError
from contid.robot_file.load import find_robot_file
from contid.robot_file.simulated_body import SimulatedPayload, SimulatedTendons
from contid_manual.schema import meanings, robot_file_schema


@pytest.mark.parametrize("length", [250, 251, 255, 256, 5000])
def test_a_long_name_is_no_robot_file(length: int) -> None:
    with pytest.raises(ContidError, match=r"no such file|cannot read it"):
        find_robot_file("a" * length)


@pytest.mark.parametrize("name", ["hand.yml", "hand.yaml", "hnd"])
def test_each_shipped_robot_is_listed_once(name: str) -> None:
    with pytest.raises(ContidError) as raised:
        find_robot_file(name)
    assert ".emulated" not in str(raised.value)
    assert "did you mean 'hand'?" in str(raised.value)


def test_a_schema_without_drivers_is_one() -> None:
    schema = robot_file_schema(drivers=())
    jsonschema.Draft202012Validator.check_schema(schema)
    bus = {"$defs": schema["$defs"], "$ref": "#/$defs/BusDescription"}
    assert not jsonschema.Draft202012Validator(bus).is_valid({"driver": "sim"})


def test_what_a_base_describes_is_described_the_same() -> None:
    own, base = meanings(SimulatedTendons), meanings(SimulatedPayload)
    assert {key: own[key] for key in base} == base
