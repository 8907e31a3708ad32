"""The YAML files of a machine of a fleet (`contid fleet serve`) and of an operator."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator

from contid.errors import BadInputError, ContidError, first_findings
from contid.robot_file.base import Strict
from contid.robot_file.findings import explain
from contid.robot_file.positions import read_document, read_text
from contid_fleet.access_rules import access_rules
from contid_fleet.certificates import MACHINE, check_validity
from contid_fleet.endpoints import check_endpoint, protocol
from contid_fleet.keys import NAME_RULE, is_name, is_node_name
from contid_fleet.rights import Right

#: Where the commands of an operator look for its file.
OPERATOR_FILES: Final = (Path("fleet.yaml"), Path("~/.config/contid/fleet.yaml"))


def _checked(value: str, valid: Callable[[str], bool], what: str) -> str:
    if not valid(value):
        raise ValueError(f"{value!r} is no name of {what}")
    return value


Name = Annotated[str, AfterValidator(partial(_checked, valid=is_name, what=f"a fleet: {NAME_RULE}"))]
NodeName = Annotated[
    str, AfterValidator(partial(_checked, valid=is_node_name, what=f"a node: {NAME_RULE}, and not `who`"))
]
Listen = Annotated[str, AfterValidator(partial(check_endpoint, listening=True))]
Connect = Annotated[str, AfterValidator(partial(check_endpoint, listening=False))]


class Tls(Strict):
    """Files of TLS (PEM): the CA of the fleet, the certificate, and its private key."""

    ca: Path
    certificate: Path
    key: Path

    def check(self) -> None:
        """Refuse files that are missing, or a key that others can read.

        Raises:
            ContidError: with the remedy.
        """
        for path in (self.ca, self.certificate, self.key):
            if not path.is_file():
                raise ContidError(f"{path}: no such file; `contid fleet cert` writes it")
        if self.key.stat().st_mode & 0o077:
            raise ContidError(f"{self.key}: other users can read this private key; chmod 600 {self.key}")
        check_validity(self.certificate)


class FeedFile(Strict):
    """The robots of a machine hold ``after_s`` after the last feed of an operator (`contid fleet feed`)."""

    operator: Name
    after_s: float = Field(default=0.5, ge=0.1, le=10.0)


class FleetFile(Strict):
    """What the files of machines, operators and routers have."""

    fleet: Name
    connect: list[Connect] = Field(default_factory=list, max_length=64)
    tls: Tls | None = None

    def endpoints(self) -> list[str]:
        """Every endpoint of the file."""
        return self.connect

    @model_validator(mode="after")
    def _has_tls(self) -> Self:
        if self.tls is None and any(protocol(each) == "tls" for each in self.endpoints()):
            raise ValueError("a tls/ endpoint needs tls: {ca: ..., certificate: ..., key: ...}")
        return self

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            ContidError: with every mistake and its place.
        """
        document = read_document(read_text(path), str(path))
        try:
            loaded = cls.model_validate_json(json.dumps(document.data), strict=True)
        except ValidationError as error:
            raise BadInputError(first_findings(explain(error, document, (), cls))) from None
        if loaded.tls is None:
            return loaded
        # Paths of a file are relative to its folder.
        tls = loaded.tls.model_copy(
            update={name: path.parent / value for name, value in loaded.tls.model_dump().items()}
        )
        tls.check()
        return loaded.model_copy(update={"tls": tls})


def check_names(
    endpoints: Sequence[str], operators: Mapping[str, Sequence[Right]], trust_local_users: bool
) -> None:
    """Refuse rights beyond `watch` where names of operators are not verified.

    Raises:
        ValueError: with the remedy.
    """
    if len({protocol(each) == "tls" for each in endpoints}) > 1:
        raise ValueError("TLS and other endpoints are not mixed: names would be verified on some only")
    plain = [each for each in endpoints if protocol(each) != "tls"]
    more = [name for name, rights in operators.items() if {*rights} - {Right.WATCH}]
    if plain and more and not trust_local_users:
        raise ValueError(
            f"{plain[0]} has no TLS, so names of operators are not verified; {more[0]!r} may only have "
            "`watch`. With trust_local_users: true every user who reaches the endpoint has these rights"
        )


class MachineFile(FleetFile):
    """What `contid fleet serve` offers.

    Attributes:
        listen: endpoints for operators.
        connect: endpoints of a router (`contid fleet route`); the machine then listens nowhere.
        router: name of the router's certificate; with TLS no other may pass orders on.
        nodes: socket by name of the node; empty for every daemon that `contid status` finds.
        operators: rights by name of the operator.
        trust_local_users: without TLS names are not verified. True: every user that reaches the endpoint
            has the rights of the name it gives.
        telemetry_hz: rate of the published telemetry.
        hold_without_feed: the operator whose feed keeps the robots moving, None without.
    """

    listen: list[Listen] = Field(default_factory=list, max_length=16)
    router: Name | None = None
    nodes: dict[NodeName, Path] = Field(default_factory=dict, max_length=64)
    operators: dict[Name, list[Right]] = Field(default_factory=dict, max_length=256)
    trust_local_users: bool = False
    telemetry_hz: float = Field(default=20.0, ge=0.0, le=200.0)
    hold_without_feed: FeedFile | None = None

    def endpoints(self) -> list[str]:
        """Every endpoint of the file."""
        return [*self.listen, *self.connect]

    def access_rules(self) -> dict[str, Any]:
        """The access rules of the bridge."""
        router = None if self.router is None else MACHINE + self.router
        return access_rules(self.fleet, self.operators, router)

    @model_validator(mode="after")
    def _is_reachable(self) -> Self:
        feed = self.hold_without_feed
        if feed is not None and feed.operator not in self.operators:
            raise ValueError(f"hold_without_feed: operator: {feed.operator!r} is no operator of this file")
        if not self.endpoints():
            raise ValueError("an endpoint is expected: listen: [tcp/127.0.0.1:7447], or connect: [...]")
        if self.listen and self.connect:
            raise ValueError(
                "listen: is for operators, connect: for a router that they are linked with; give one of them"
            )
        if self.connect and self.tls is not None and self.router is None:
            raise ValueError("connect: needs router: NAME, that of the certificate of the router")
        check_names(self.endpoints(), self.operators, self.trust_local_users)
        return self


class OperatorFile(FleetFile):
    """How an operator reaches the fleet.

    Attributes:
        operator: its name, that of its certificate.
        expected: nodes that a fleet stop must reach; it also asks those it finds.
    """

    operator: Name
    expected: list[NodeName] = Field(default_factory=list, max_length=1024)

    @model_validator(mode="after")
    def _connects(self) -> Self:
        if not self.connect:
            raise ValueError("connect: endpoints of the machines or of a router are expected")
        return self


def load_operator_file(path: Path | None) -> OperatorFile:
    """Read the file of an operator; None for the first of `OPERATOR_FILES` that exists.

    Raises:
        ContidError: there is none, or with every mistake and its place.
    """
    if path is None:
        found = [each.expanduser() for each in OPERATOR_FILES if each.expanduser().is_file()]
        if not found:
            listed = " or ".join(map(str, OPERATOR_FILES))
            raise ContidError(f"no file of an operator: {listed}; give --file FILE (docs/fleet.md)")
        path = found[0]
    return OperatorFile.load(path)
