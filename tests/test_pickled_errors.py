"""Errors cross from process to process: each is the same after a pickle."""

from __future__ import annotations

import copy
import pickle

import pytest

from contid.errors import BadInputError, ContidError, DeviceError, DeviceLostError, Located, MissingExtraError
from contid.remote.protocol.wire import Code, RemoteError

ERRORS = [
    ContidError("wrong"),
    BadInputError([Located("arm.yaml", 3, 1, "unknown key"), Located("arm.yaml", 4, 1, "another")]),
    DeviceError("arm.x", "is silent", "look at its plug"),
    DeviceLostError("arm.x", "is gone"),
    MissingExtraError("to_pandas", "pandas", "data"),
    RemoteError(Code.FAULT, "arm: fault", {"arm": {"number": 104}}),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_survives_a_pickle(error: ContidError) -> None:
    for other in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(other) is type(error)
        assert str(other) == str(error)
        assert other.__dict__ == error.__dict__
        assert other.exit_code == error.exit_code
