"""Keys and endpoints: what is no key of an order, and what would leave the machine, is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid_fleet.endpoints import check_endpoint
from contid_fleet.keys import NAME, Keys, Order, Origin

KEYS = Keys("lab")
names = st.from_regex(NAME, fullmatch=True)


@given(node=names.filter(lambda name: name != "who"), operator=names, session=names, verb=names)
def test_a_key_of_an_order_has_its_parts(node: str, operator: str, session: str, verb: str) -> None:
    key = KEYS.do(node, operator, session, verb)
    assert KEYS.order(key) == Order(node, Origin(operator, session), verb)
    assert KEYS.order(KEYS.do("*", operator, session, verb)) == Order(None, Origin(operator, session), verb)
    assert Keys("other").order(key) is None


@pytest.mark.parametrize(
    "key",
    [
        "contid/lab/h/do/*/s/move",
        "contid/lab/h/do/anna/*/move",
        "contid/lab/h/do/anna/s/*",
        "contid/lab/h/do/**/move",
        "contid/lab/**",
        "contid/lab/h$*/do/anna/s/move",
        "contid/*/h/do/anna/s/move",
        "contid/lab/h/do/Anna/s/move",
        "contid/lab/who/do/anna/s/move",
    ],
)
def test_only_the_node_may_be_a_wildcard(key: str) -> None:
    assert KEYS.order(key) is None


@pytest.mark.parametrize(
    "endpoint",
    [
        "tls/192.168.1.10:7447",
        "tls/[fe80::1]:7447",
        "tcp/127.0.0.1:1",
        "tcp/[::1]:7447",
        "unixsock-stream//r/s",
    ],
)
def test_tls_or_this_machine(endpoint: str) -> None:
    check_endpoint(endpoint, listening=True)


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp/192.168.1.10:7447", "without TLS"),
        ("tcp/0.0.0.0:7447", "every address"),
        ("tls/0.0.0.0:7447", "every address"),
        ("tls/[::]:7447", "every address"),
        ("tcp/localhost:7447", "IP address"),
        ("udp/127.0.0.1:7447", "one of"),
        ("quic/127.0.0.1:7447", "one of"),
        ("tcp/127.0.0.1:7447#iface=eth0", "options"),
        ("tcp/127.0.0.1:7447;tcp/192.168.1.10:7447", "options"),
        ("tcp/127.0.0.1", "port"),
        ("tcp/127.0.0.1:0", "port"),
        ("unixsock-stream/s", "absolute"),
    ],
)
def test_other_endpoints_are_refused(endpoint: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        check_endpoint(endpoint, listening=True)


def test_an_operator_connects_by_name_with_tls_only() -> None:
    check_endpoint("tls/hand-pc.lab.example:7447", listening=False)
    with pytest.raises(ValueError, match="without TLS"):
        check_endpoint("tcp/hand-pc:7447", listening=False)
