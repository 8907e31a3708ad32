"""The monotone cubic is scipy's PCHIP, strictly monotone, and inverts to the last bits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from contid.control.tick.monotone_cubic import MonotoneCubic

step = st.floats(0.05, 20.0)
tables = st.lists(st.tuples(step, step), min_size=1, max_size=8).flatmap(
    lambda steps: st.builds(
        lambda x0, y0, sign: (
            np.cumsum([x0, *(h for h, _ in steps)]),
            sign * np.cumsum([y0, *(dy for _, dy in steps)]),
        ),
        st.floats(-10, 10),
        st.floats(-10, 10),
        st.sampled_from([1.0, -1.0]),
    )
)


@settings(max_examples=50)
@given(table=tables)
def test_equals_scipy(table):
    x, y = table
    curve, oracle = MonotoneCubic(x.tolist(), y.tolist()), PchipInterpolator(*table)
    at = np.linspace(x[0], x[-1], 101)
    assert [curve(float(v)) for v in at] == pytest.approx(oracle(at), abs=1e-10)


@settings(max_examples=50)
@given(table=tables, share=st.floats(0.0, 1.0))
def test_inverse_meets_its_value(table, share):
    x, y = table
    curve = MonotoneCubic(x.tolist(), y.tolist())
    value = float(y[0] + share * (y[-1] - y[0]))
    found = curve.inverse(value)
    assert x[0] <= found <= x[-1]
    assert curve(found) == pytest.approx(value, abs=1e-12 * float(1.0 + np.ptp(y)))


@given(table=tables)
def test_strictly_monotone(table):
    x, y = table
    curve = MonotoneCubic(x.tolist(), y.tolist())
    # Beside a steep neighbour a slope may vanish at the knot, so compare points a finite distance apart.
    values = np.array([curve(float(v)) for v in np.linspace(x[0], x[-1], 30)])
    assert np.all(np.diff(values) * np.sign(y[-1] - y[0]) > 0)


def test_stays_at_the_ends_of_the_table():
    curve = MonotoneCubic([0.0, 1.0, 3.0], [5.0, 4.0, 0.0])
    assert (curve(-1.0), curve(9.0)) == (5.0, 0.0)
    assert (curve.inverse(7.0), curve.inverse(-3.0)) == (0.0, 3.0)


def test_two_rows_are_a_straight_line():
    curve = MonotoneCubic([0.0, 2.0], [1.0, 5.0])
    assert curve(0.5) == 2.0
    assert curve.inverse(2.0) == 0.5
