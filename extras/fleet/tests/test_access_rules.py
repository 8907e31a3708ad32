"""The generated rules of Zenoh: no operator asks in the name of another, or beyond its rights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contid_fleet.access_rules import access_rules, router_rules
from contid_fleet.keys import NAME, Keys
from contid_fleet.rights import NEEDED, Right
from tests.support.command import contid

KEYS = Keys("lab")
VERBS = sorted(NEEDED)
names = st.from_regex(NAME, fullmatch=True)
operators = st.dictionaries(names, st.lists(st.sampled_from(Right), unique=True), max_size=5)
machines = st.dictionaries(names.map("machine:{}".format), st.lists(names, max_size=3), max_size=3)
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


@given(
    operators=operators,
    machines=machines | st.none(),
    node=chunks,
    session=chunks,
    verb=st.sampled_from(VERBS),
)
def test_an_operator_asks_in_its_own_name_and_within_its_rights(
    operators: dict[str, list[Right]],
    machines: dict[str, list[str]] | None,
    node: str,
    session: str,
    verb: str,
) -> None:
    """Linked with a bridge, and with a router alike."""
    rules = access_rules("lab", operators) if machines is None else router_rules("lab", operators, machines)
    for subject, rights in operators.items():
        for name in [*operators, "stranger-of-all", "*"]:
            key = KEYS.do(node, name, session, verb)
            need = NEEDED[verb]
            expected = name == subject and need is not None and (not need or bool(need & {*rights}))
            assert allows(rules, subject, "ingress", "query", key) == expected


@given(operators=operators, machines=machines | st.none(), node=chunks, session=chunks)
def test_tokens_and_notices_are_those_of_the_operator(
    operators: dict[str, list[Right]], machines: dict[str, list[str]] | None, node: str, session: str
) -> None:
    rules = access_rules("lab", operators) if machines is None else router_rules("lab", operators, machines)
    for subject, rights in operators.items():
        for name in [*operators, "*"]:
            own = name == subject
            who, notices = KEYS.who(name, session), KEYS.notices(node, name)
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


@given(operators=operators, machines=machines, node=names, verb=st.sampled_from(VERBS))
def test_a_machine_is_its_own_nodes_and_asks_nothing(
    operators: dict[str, list[Right]], machines: dict[str, list[str]], node: str, verb: str
) -> None:
    rules = router_rules("lab", operators, machines)
    for subject, nodes in machines.items():
        for each in {node, *nodes}:
            own = each in nodes
            for message, key in (
                ("liveliness_token", KEYS.alive(each, "b")),
                ("declare_queryable", KEYS.do(each, "*", "*", "*")),
                ("reply", KEYS.do(each, "anna", "s", verb)),
                ("put", KEYS.telemetry(each)),
                ("put", KEYS.event(each)),
                ("put", KEYS.notices(each, "anna")),
            ):
                assert allows(rules, subject, "ingress", message, key) == own
        for asked in (node, "*"):
            assert not allows(rules, subject, "ingress", "query", KEYS.do(asked, "anna", "s", verb))
            assert not allows(rules, subject, "ingress", "put", KEYS.telemetry("*"))
            assert not allows(rules, subject, "ingress", "declare_queryable", KEYS.do("*", "*", "*", "*"))
            assert not allows(rules, subject, "ingress", "declare_subscriber", KEYS.telemetry(asked))
        assert not allows(rules, subject, "ingress", "liveliness_token", KEYS.who("anna", "s"))
        assert not allows(rules, subject, "ingress", "liveliness_token", KEYS.alive("*", "b"))


@given(operators=operators, node=chunks, verb=st.sampled_from(VERBS))
def test_behind_a_router_only_the_router_has_rights_and_no_more_than_its_operators(
    operators: dict[str, list[Right]], node: str, verb: str
) -> None:
    rules = access_rules("lab", operators, "machine:hub")
    assert [each["cert_common_names"] for each in rules["subjects"]] == [["machine:hub"]]
    for name in [*operators, "stranger-of-all", "*"]:
        need = NEEDED[verb]
        rights = {*operators.get(name, ())}
        expected = name in operators and need is not None and (not need or bool(need & rights))
        assert allows(rules, "machine:hub", "ingress", "query", KEYS.do(node, name, "s", verb)) == expected


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


@pytest.mark.process
@pytest.mark.parametrize(
    ("more", "options"), [("", ()), ("machines: {pc1: [hand1]}\n", ("--router",))], ids=["bridge", "router"]
)
def test_the_command_prints_what_zenoh_reads(more: str, options: tuple[str, ...], tmp_path: Path) -> None:
    import zenoh

    path = tmp_path / "file.yaml"
    path.write_text(f"fleet: lab\nlisten: [tcp/127.0.0.1:7447]\noperators: {{wall: [watch]}}\n{more}")
    done = contid("fleet", "acl", str(path), *options)
    assert done.returncode == 0, done.stderr
    config = zenoh.Config.from_json5(done.stdout)
    assert json.loads(config.get_json("access_control/default_permission")) == "deny"
