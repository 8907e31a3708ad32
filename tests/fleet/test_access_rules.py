"""The generated rules of Zenoh: no operator asks in the name of another, or beyond its rights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from contid.fleet.access_rules import access_rules
from contid.fleet.keys import NAME, Keys
from contid.fleet.rights import STOPS, VERBS, Right, needed
from tests.support.command import contid

KEYS = Keys("lab")
VERBS_AND_OTHERS = sorted({*VERBS, *STOPS, "hello", "subscribe"})
names = st.from_regex(NAME, fullmatch=True)
operators = st.dictionaries(names, st.lists(st.sampled_from(Right), unique=True), max_size=5)
chunks = names.filter(lambda name: name != "who") | st.just("*")


def allows(rules: dict[str, Any], subject: str, flow: str, message: str, key: str) -> bool:
    """What Zenoh does with a message: the key must lie within an allowed one; its own set theory of keys."""
    import zenoh

    policies = [policy for policy in rules["policies"] if subject in policy["subjects"]]
    applied = {name for policy in policies for name in policy["rules"]}
    return any(
        zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key))
        for rule in rules["rules"]
        if rule["id"] in applied and flow in rule["flows"] and message in rule["messages"]
        for expression in rule["key_exprs"]
    )


@given(operators=operators, node=chunks, session=chunks, verb=st.sampled_from(VERBS_AND_OTHERS))
def test_an_operator_asks_in_its_own_name_and_within_its_rights(
    operators: dict[str, list[Right]], node: str, session: str, verb: str
) -> None:
    rules = access_rules("lab", operators)
    for subject, rights in operators.items():
        for name in [*operators, "stranger-of-all", "*"]:
            key = KEYS.do(node, name, session, verb)
            need = needed(verb)
            expected = name == subject and need is not None and (not need or bool(need & {*rights}))
            assert allows(rules, subject, "ingress", "query", key) == expected


@given(operators=operators, node=chunks, session=chunks)
def test_tokens_and_notices_are_those_of_the_operator(
    operators: dict[str, list[Right]], node: str, session: str
) -> None:
    rules = access_rules("lab", operators)
    for subject, rights in operators.items():
        for name in [*operators, "*"]:
            own = name == subject
            who, notices = KEYS.who(name, session), KEYS.notices_of(node, name)
            assert allows(rules, subject, "ingress", "liveliness_token", who) == own
            assert allows(rules, subject, "ingress", "declare_subscriber", notices) == own
            assert allows(rules, subject, "egress", "put", notices) == own
        watches = allows(rules, subject, "ingress", "declare_subscriber", KEYS.telemetry(node))
        assert watches == (Right.WATCH in rights)
        # No operator is a node, publishes, or answers.
        assert not allows(rules, subject, "ingress", "liveliness_token", KEYS.alive(node, "b"))
        for message in ("put", "delete", "reply", "declare_queryable"):
            assert not allows(rules, subject, "ingress", message, f"contid/lab/{node}/do/{subject}/s/move")
            assert not allows(rules, subject, "ingress", message, KEYS.telemetry(node))
        assert not allows(rules, subject, "ingress", "query", "contid/lab/**")
        assert not allows(rules, subject, "ingress", "query", Keys("other").do(node, subject, "s", "estop"))


@given(operators=operators)
def test_rules_only_allow_and_the_rest_is_denied(operators: dict[str, list[Right]]) -> None:
    rules = access_rules("lab", operators)
    assert rules["enabled"]
    assert rules["default_permission"] == "deny"
    assert {rule["permission"] for rule in rules["rules"]} <= {"allow"}
    # A subject without a certificate would be everybody.
    assert [subject["cert_common_names"] for subject in rules["subjects"]] == [[n] for n in sorted(operators)]
    identifiers = [rule["id"] for rule in rules["rules"]]
    assert len(identifiers) == len({*identifiers})


def test_the_command_prints_what_zenoh_reads(tmp_path: Path) -> None:
    import zenoh

    path = tmp_path / "machine.yaml"
    path.write_text("fleet: lab\nlisten: [tcp/127.0.0.1:7447]\noperators: {wall: [watch]}\n")
    done = contid("fleet", "acl", str(path))
    assert done.returncode == 0, done.stderr
    config = zenoh.Config.from_json5(done.stdout)
    assert json.loads(config.get_json("access_control/default_permission")) == "deny"
