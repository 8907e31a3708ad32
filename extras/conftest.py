"""Every fixture and hook of `tests/conftest.py` holds for the tests of the extras."""

from tests.conftest import *
