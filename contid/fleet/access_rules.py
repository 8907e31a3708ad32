"""The access rules of Zenoh for the file of a machine: deny by default, each operator in its own name only.

Zenoh binds the rules to the common name of a certificate, before a request reaches the bridge. The bridge
checks the same rights again (`contid.fleet.gate`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from contid.fleet.keys import Keys
from contid.fleet.rights import Right, allowed_verbs

INGRESS: Final = "ingress"
EGRESS: Final = "egress"


def access_rules(fleet: str, operators: Mapping[str, Sequence[Right]]) -> dict[str, Any]:
    """The section ``access_control`` of a configuration of Zenoh.

    Args:
        fleet: its name.
        operators: rights by common name of the certificate.
    """
    keys = Keys(fleet)
    rules: list[dict[str, Any]] = []
    subjects: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for name, rights in sorted(operators.items()):
        own = list(_rules(keys, name, frozenset(rights)))
        rules += own
        subjects.append({"id": name, "cert_common_names": [name]})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(keys: Keys, name: str, rights: frozenset[Right]) -> Iterator[dict[str, Any]]:
    """The rules of one operator; directions are those of the bridge."""

    def rule(what: str, flow: str, messages: Sequence[str], expressions: Sequence[str]) -> dict[str, Any]:
        return {
            "id": f"{name} {what}",
            "permission": "allow",
            "flows": [flow],
            "messages": list(messages),
            "key_exprs": list(expressions),
        }

    asked = [keys.do("*", name, "*", verb) for verb in allowed_verbs(rights)]
    alive = keys.alive("*", "*")
    yield rule("asks", INGRESS, ["query"], asked)
    yield rule("is answered", EGRESS, ["reply"], asked)
    yield rule("finds", EGRESS, ["declare_queryable"], [keys.do("*", "*", "*", "*")])
    yield rule("is there", INGRESS, ["liveliness_token"], [keys.who(name, "*")])
    yield rule("is looked for", EGRESS, ["declare_liveliness_subscriber"], [keys.who("*", "*"), alive])
    yield rule("looks for nodes", INGRESS, ["declare_liveliness_subscriber", "liveliness_query"], [alive])
    yield rule("sees nodes", EGRESS, ["liveliness_token"], [alive])
    published = [keys.notices_of("*", name)]
    if Right.WATCH in rights:
        published += [keys.telemetry("*"), keys.event("*")]
    yield rule("subscribes", INGRESS, ["declare_subscriber"], published)
    yield rule("receives", EGRESS, ["put"], published)
