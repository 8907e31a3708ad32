"""Numbers as text: the compiled kernel against Python's own repr, which is its oracle."""

from __future__ import annotations

import numpy as np

from contid.kernels import load

#: Powers of ten around the change to exponents, the ends of the range, halfway cases, whole numbers.
POWERS = (-324, -323, -308, -5, -4, -1, 0, 1, 15, 16, 17, 22, 23, 100, 307)
EDGES = [
    *(float(f"{digits}e{power}") for digits in ("1", "-9.5", "1.2345678901234567") for power in POWERS),
    *(0.0, -0.0, 5e-324, 2.2250738585072014e-308, 1.7976931348623157e308),
    *(float("inf"), float("-inf"), float("nan"), -float("nan")),
    *(2.0**53, 2.0**53 + 2, 9007199254740993.0, 123456789012345680.0),
    *(0.1, 0.3, 1 / 3, 1e15 + 0.3),
    *(np.nextafter(edge, toward) for edge in (1e-4, 1e16) for toward in (0.0, np.inf)),
]


def numbers() -> np.ndarray:
    rng = np.random.default_rng(5)
    of_bits = np.frombuffer(rng.bytes(8 * 20_000), np.float64)  # every exponent, NaN and infinity
    usual = np.concatenate([rng.uniform(-200.0, 200.0, 10_000), rng.normal(0.0, 1e-6, 10_000)])
    whole = np.round(10.0 ** rng.uniform(0.0, 17.0, 10_000))
    rounded = np.round(rng.uniform(-1000.0, 1000.0, 10_000), 6)
    return np.concatenate([EDGES, of_bits, usual, whole, rounded])


def test_every_number_is_written_as_python_writes_it() -> None:
    kernel = load("text")
    given = numbers()
    assert kernel.joined(given[:, None]) == [repr(x) for x in given.tolist()]
    rows = given[: len(given) // 7 * 7].reshape(-1, 7)
    assert kernel.joined(rows) == [",".join(map(repr, row)) for row in rows.tolist()]
    assert kernel.joined(np.empty((0, 3))) == []
