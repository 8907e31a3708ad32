"""TLS: who has no valid certificate of the fleet gets no link; who has one acts in its own name only."""

from __future__ import annotations

import errno
import json
import shutil
import stat
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from contid.errors import ContidError
from contid_fleet.certificates import make_ca, make_certificate
from contid_fleet.fleet_file import MachineFile, Tls
from contid_fleet.keys import is_name
from contid_fleet.net import NetSession
from contid_fleet.net_settings import NetSettings, configuration
from contid_fleet.operator import FleetOperator
from contid_fleet.stops import stop_fleet
from tests.support.command import contid
from tests.support.daemons import daemon
from tests.support.fleets import BridgeProcess, bridge, machine_file
from tests.support.ports import free_port
from tests.support.waiting import until

pytestmark = [pytest.mark.process, pytest.mark.realtime]

#: A link of a valid certificate is there after some milliseconds.
NO_LINK_S = 1.5


def tls(folder: Path, name: str, ca: Path | None = None) -> dict[str, str]:
    """The section of a file."""
    own = {"certificate": str(folder / f"{name}.pem"), "key": str(folder / f"{name}.key")}
    return {"ca": str((ca or folder) / "ca.pem"), **own}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ca")
    make_ca(folder, "lab")
    make_certificate(folder, folder, "pc1", ["127.0.0.1"])
    for name in ("anna", "bob", "eve"):
        make_certificate(folder, folder, name)
    make_certificate(folder, folder, "late", days=-1)
    return folder


@pytest.fixture(scope="module")
def served(certificates: Path) -> Iterator[BridgeProcess]:
    with daemon() as node:
        endpoint = f"tls/127.0.0.1:{free_port()}"
        operators = {"anna": ["watch", "move", "arm"], "bob": ["watch"], "late": ["watch"]}
        files: dict[str, Any] = {"tls": tls(certificates, "pc1"), "operators": operators}
        with bridge({"hand1": node.socket}, endpoint=endpoint, **files) as started:
            yield started


def links(settings: Tls | None, endpoint: str, **change: Any) -> bool:
    """True when a session with these files gets a link."""
    import zenoh

    config = configuration(NetSettings(connect=[endpoint], tls=settings))
    config["transport"]["link"].get("tls", {}).update(change)
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    try:
        deadline_s = time.monotonic() + NO_LINK_S
        while time.monotonic() < deadline_s:
            if session.info.peers_zid():
                return True
            time.sleep(0.02)
        return False
    finally:
        session.close()


def files(folder: Path, name: str, ca: Path | None = None) -> Tls:
    return Tls(**{key: Path(value) for key, value in tls(folder, name, ca).items()})


def test_a_certificate_of_the_fleet_gets_a_link(served: BridgeProcess, certificates: Path) -> None:
    assert links(files(certificates, "bob"), served.endpoint)


def test_an_expired_certificate_gets_none(served: BridgeProcess, certificates: Path) -> None:
    assert not links(files(certificates, "late"), served.endpoint)


def test_a_foreign_certificate_gets_none(served: BridgeProcess, certificates: Path, tmp_path: Path) -> None:
    make_ca(tmp_path, "lab")
    make_certificate(tmp_path, tmp_path, "anna")
    # It trusts the machine, and the machine does not trust it.
    assert not links(files(tmp_path, "anna", ca=certificates), served.endpoint)
    # It trusts another CA than that of the machine.
    assert not links(files(tmp_path, "anna"), served.endpoint)


def test_without_a_certificate_there_is_no_link(served: BridgeProcess, certificates: Path) -> None:
    none = {"connect_certificate": None, "connect_private_key": None, "enable_mtls": False}
    assert not links(files(certificates, "anna"), served.endpoint, **none)
    assert not links(None, served.endpoint.replace("tls/", "tcp/"))


def test_a_certificate_of_an_operator_is_of_no_use_to_others(certificates: Path) -> None:
    """Otherwise an operator could take the place of a machine, and confirm stops."""
    endpoint = f"tls/127.0.0.1:{free_port()}"
    net = NetSession(NetSettings(listen=[endpoint], tls=files(certificates, "bob")))
    try:
        assert not links(files(certificates, "anna"), endpoint)
    finally:
        net.close()


def test_an_operator_moves_and_stops_in_its_own_name(served: BridgeProcess, certificates: Path) -> None:
    path = str(served.operator_file(tls=tls(certificates, "anna")))
    moved = contid("fleet", "move", "hand1", "x_mm=30", "y_mm=85", "--file", path)
    assert moved.returncode == 0, moved.stderr
    stopped = contid("fleet", "hold", "--file", path)
    assert stopped.returncode == 0, stopped.stdout
    assert "hand1: hold confirmed in tick" in stopped.stdout


@pytest.mark.parametrize("certificate", ["bob", "eve"])
def test_another_name_than_that_of_the_certificate_reaches_nothing(
    served: BridgeProcess, certificates: Path, certificate: str
) -> None:
    """Neither with a certificate that has rights, nor with one that the machine does not list."""
    with FleetOperator(served.operator("anna", tls=tls(certificates, certificate))) as operator:
        until(operator.net.peers, "the link is there")
        for verb in ("status", "acquire", "move", "hold"):
            assert operator.ask("hand1", verb, {}, 0.5) is None
        report = stop_fleet(operator, "estop", ["hand1"])
        assert report.missing == ("hand1",)
        assert not report.complete


def test_who_may_watch_only_watches_and_stops(served: BridgeProcess, certificates: Path) -> None:
    with FleetOperator(served.operator("bob", tls=tls(certificates, "bob"))) as operator:
        until(lambda: "hand1" in operator.nodes(), "the node is there")
        assert (operator.ask("hand1", "status", {}, 5.0) or {}).get("ok")
        assert (operator.ask("hand1", "hold", {}, 5.0) or {}).get("ok")
        for verb in ("acquire", "move", "resume", "measure"):
            assert operator.ask("hand1", verb, {}, 0.5) is None


def test_private_keys_are_private(certificates: Path, tmp_path: Path) -> None:
    for path in certificates.glob("*.key"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    shutil.copy(certificates / "pc1.key", tmp_path / "pc1.key")
    (tmp_path / "pc1.key").chmod(0o640)
    section = {**tls(certificates, "pc1"), "key": str(tmp_path / "pc1.key")}
    path = machine_file(tmp_path, "tls/127.0.0.1:7447", {}, tls=section)
    with pytest.raises(ContidError, match="chmod 600"):
        MachineFile.load(path)


def test_the_owner_of_an_expired_certificate_reads_when(certificates: Path, tmp_path: Path) -> None:
    path = machine_file(tmp_path, "tls/127.0.0.1:7447", {}, tls=tls(certificates, "late"))
    with pytest.raises(ContidError, match="expired at"):
        MachineFile.load(path)


def test_a_machine_cannot_have_the_name_of_an_operator(certificates: Path, tmp_path: Path) -> None:
    """With a certificate for a machine called anna nothing is done in the name of anna."""
    from cryptography import x509

    make_certificate(tmp_path, certificates, "anna", ["127.0.0.1"])
    subject = x509.load_pem_x509_certificate((tmp_path / "anna.pem").read_bytes()).subject
    names = [str(each.value) for each in subject]
    assert names == ["machine:anna"]
    assert not any(map(is_name, names))


@pytest.mark.parametrize("host", ["bad host!", "", "*.lab", "a/b"])
def test_a_host_is_an_address_or_a_name(certificates: Path, tmp_path: Path, host: str) -> None:
    with pytest.raises(ContidError, match="host name is expected"):
        make_certificate(tmp_path, certificates, "pc3", [host])


def test_files_are_not_replaced(certificates: Path) -> None:
    with pytest.raises(ContidError, match="not replaced"):
        make_ca(certificates, "lab")
    with pytest.raises(ContidError, match="not replaced"):
        make_certificate(certificates, certificates, "anna")


def test_half_a_pair_is_not_left_behind(
    certificates: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a full disk the certificate fails behind its key; the next attempt finds no file in its way."""

    def full(self: Path, data: bytes) -> int:
        self.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", full)
        with pytest.raises(ContidError, match="cannot write it: No space left"):
            make_certificate(tmp_path, certificates, "dora")
    assert not [*tmp_path.iterdir()]
    assert make_certificate(tmp_path, certificates, "dora").is_file()


def test_tls_and_other_endpoints_are_not_mixed(certificates: Path, tmp_path: Path) -> None:
    listen = ["tls/127.0.0.1:7447", "tcp/127.0.0.1:7448"]
    path = machine_file(tmp_path, listen[0], {}, listen=listen, tls=tls(certificates, "pc1"))
    with pytest.raises(ContidError, match="not mixed"):
        MachineFile.load(path)


def test_openssl_accepts_the_certificates(certificates: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")

    def verified(name: str, *arguments: str) -> bool:
        given = ["openssl", "verify", "-x509_strict", "-CAfile", str(certificates / "ca.pem"), *arguments]
        path = str(certificates / f"{name}.pem")
        return subprocess.run([*given, path], capture_output=True).returncode == 0

    assert verified("pc1", "-purpose", "sslserver", "-verify_ip", "127.0.0.1")
    assert verified("pc1", "-purpose", "sslclient")
    assert not verified("pc1", "-purpose", "sslserver", "-verify_ip", "127.0.0.2")
    assert verified("anna", "-purpose", "sslclient")
    assert not verified("anna", "-purpose", "sslserver")
    assert not verified("late", "-purpose", "sslclient")
