"""The access rules of Zenoh: everything is denied but what the rules here allow.

An operator may ask in its own name only, and a machine may answer for its own nodes only. Zenoh applies the
rules by the common name of a certificate, before a request reaches the bridge. The bridge checks the same
rights of operators again (`contid_fleet.gate`). Behind a router the bridge sees the name of the router alone,
so the router's rules are those that bind an operator to its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, Final

from contid_fleet.keys import Keys
from contid_fleet.rights import Right, allowed_verbs

INGRESS: Final = "ingress"
EGRESS: Final = "egress"


def access_rules(
    fleet: str, operators: Mapping[str, Sequence[Right]], router: str | None = None
) -> dict[str, Any]:
    """The section ``access_control`` of a configuration of Zenoh, for a bridge.

    Args:
        fleet: its name.
        operators: rights by common name of the certificate.
        router: common name of the router, or None. With a router the bridge has no other link and sees no
            other name, so the rules of all operators apply to the name of the router, which has checked
            their own names.
    """
    keys = Keys(fleet)
    named = {name: list(_operator(keys, name, frozenset(rights))) for name, rights in operators.items()}
    if router is None:
        return _section(named)
    return _section({router: [*chain(*named.values()), *_by_router(keys)]})


def router_rules(
    fleet: str, operators: Mapping[str, Sequence[Right]], machines: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """The section ``access_control`` of a configuration of Zenoh, for a router.

    Args:
        fleet: its name.
        operators: rights by common name of the certificate.
        machines: names of the nodes by common name of the certificate.
    """
    keys = Keys(fleet)
    named = {name: list(_operator(keys, name, frozenset(rights))) for name, rights in operators.items()}
    return _section(named | {name: list(_machine(keys, name, nodes)) for name, nodes in machines.items()})


def _section(named: Mapping[str, Sequence[dict[str, Any]]]) -> dict[str, Any]:
    """Rules by the common name that they are bound to."""
    names = sorted(named)
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for name in names for rule in named[name]],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in names],
        "policies": [{"rules": [rule["id"] for rule in named[name]], "subjects": [name]} for name in names],
    }


def _rule(
    whose: str, what: str, flow: str, messages: Sequence[str], expressions: Sequence[str]
) -> dict[str, Any]:
    return {
        "id": f"{whose} {what}",
        "permission": "allow",
        "flows": [flow],
        "messages": list(messages),
        "key_exprs": list(expressions),
    }


def _operator(keys: Keys, name: str, rights: frozenset[Right]) -> Iterator[dict[str, Any]]:
    """The rules of one operator; directions are those of the bridge or router that it is linked with."""
    rule = partial(_rule, name)
    asked = [keys.do("*", name, "*", verb) for verb in allowed_verbs(rights)]
    alive = keys.alive("*", "*")
    yield rule("asks", INGRESS, ["query"], asked)
    yield rule("is answered", EGRESS, ["reply"], asked)
    yield rule("finds", EGRESS, ["declare_queryable"], [keys.do("*", "*", "*", "*")])
    yield rule("is there", INGRESS, ["liveliness_token"], [keys.who(name, "*")])
    yield rule("is looked for", EGRESS, ["declare_liveliness_subscriber"], [keys.who("*", "*"), alive])
    yield rule("looks for nodes", INGRESS, ["declare_liveliness_subscriber", "liveliness_query"], [alive])
    yield rule("sees nodes", EGRESS, ["liveliness_token"], [alive])
    published = [keys.notices("*", name)]
    if Right.WATCH in rights:
        published += [keys.telemetry("*"), keys.event("*")]
    yield rule("subscribes", INGRESS, ["declare_subscriber"], published)
    yield rule("receives", EGRESS, ["put"], published)


def _by_router(keys: Keys) -> Iterator[dict[str, Any]]:
    """Further rules of a bridge behind a router: it finds nodes of other bridges that have equal names."""
    rule, alive = partial(_rule, "router:"), keys.alive("*", "*")
    looks = ["declare_liveliness_subscriber", "liveliness_query"]
    yield rule("asks for tokens", EGRESS, looks, [alive])
    yield rule("has nodes", INGRESS, ["liveliness_token"], [alive])


def _machine(keys: Keys, name: str, nodes: Sequence[str]) -> Iterator[dict[str, Any]]:
    """The rules of the bridge of one machine, which asks nothing; directions are those of the router."""
    rule, alive = partial(_rule, name), keys.alive("*", "*")
    asked = [keys.do(node, "*", "*", "*") for node in nodes]
    published = [
        key for node in nodes for key in (keys.telemetry(node), keys.event(node), keys.notices(node, "*"))
    ]
    looked_for = [keys.who("*", "*"), alive]
    looks = ["declare_liveliness_subscriber", "liveliness_query"]
    if nodes:
        yield rule("serves", INGRESS, ["declare_queryable"], asked)
        yield rule("answers", INGRESS, ["reply"], asked)
        yield rule("is there", INGRESS, ["liveliness_token"], [keys.alive(node, "*") for node in nodes])
        yield rule("publishes", INGRESS, ["put"], published)
    # A request to every node has a wildcard; it only comes where a bridge serves.
    yield rule("is asked", EGRESS, ["query"], [keys.do("*", "*", "*", "*")])
    yield rule("is looked for", EGRESS, looks, [alive])
    yield rule("looks", INGRESS, looks, looked_for)
    yield rule("sees", EGRESS, ["liveliness_token"], looked_for)
    received = [keys.telemetry("*"), keys.event("*"), keys.notices("*", "*")]
    yield rule("is subscribed to", EGRESS, ["declare_subscriber"], received)
