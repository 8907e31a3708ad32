"""The harnesses of contid's own drivers and of the examples: one rig per driver and kind of device."""

from __future__ import annotations

from contextlib import AbstractContextManager
from importlib import import_module
from typing import Final

from contid_driverkit.contract import BusUnderTest

#: Name in the test's id -> "module:function"; the function is a context manager without arguments.
HARNESSES: Final[dict[str, str]] = {
    "due-motor": "tests.contract.due_harness:motors",
    "due-regulator": "tests.contract.due_harness:regulators",
    "dynamixel": "tests.contract.dynamixel_harness:servo",
    "feetech-echo": "feetech_rig:echo",
    "feetech-scs": "feetech_rig:scs",
    "feetech-sts": "feetech_rig:sts",
    "sim-servo": "tests.contract.sim_harness:servo",
    "sim-motor": "tests.contract.sim_harness:motor",
    "sim-regulator": "tests.contract.sim_harness:regulator",
    "winch": "winch_harness:winch",
}


def harness(name: str) -> AbstractContextManager[BusUnderTest]:
    """The harness called ``name``; imports only that one."""
    module, _, function = HARNESSES[name].partition(":")
    made: AbstractContextManager[BusUnderTest] = getattr(import_module(module), function)()
    return made
