"""Certificates of a fleet: a CA of its own, and one certificate per machine and per operator (P-256).

The common name of an operator's certificate is its name in the fleet; that of a machine has a prefix that no
operator can have. Only certificates of machines may be used to listen. Private keys have mode 0600.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from contid.errors import ContidError, require_extra
from contid_fleet.endpoints import ip_address, is_host_name
from contid_fleet.keys import NAME_RULE, is_name

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec

#: Zenoh has no revocation lists: certificates are short-lived instead, and links close when one expires.
CERTIFICATE_DAYS: Final = 30
CA_DAYS: Final = 3650
#: Before now, for machines whose clocks differ.
EARLIER: Final = datetime.timedelta(hours=1)
CA_CERTIFICATE: Final = "ca.pem"
CA_KEY: Final = "ca.key"
#: Begins the common name of a machine; a colon is in no name of an operator.
MACHINE: Final = "machine:"


def make_ca(folder: Path, fleet: str, days: float = CA_DAYS) -> Path:
    """Write ``ca.pem`` and ``ca.key`` of a new CA; returns the first.

    Raises:
        ContidError: there is one already, or the folder cannot be written.
    """
    require_extra("certificates of a fleet", "cryptography")
    from cryptography.hazmat.primitives.asymmetric import ec

    path = folder / CA_CERTIFICATE
    _check_new(fleet, path)
    key = ec.generate_private_key(ec.SECP256R1())
    builder = _builder(f"contid fleet {fleet}", key, days)
    return _write(path, builder, key, key)


def make_certificate(
    folder: Path, ca: Path, name: str, hosts: Sequence[str] = (), days: float = CERTIFICATE_DAYS
) -> Path:
    """Write ``NAME.pem`` and ``NAME.key``, signed by a CA; returns the first.

    Args:
        folder: folder for the files.
        ca: the folder of `make_ca`.
        name: name of the operator or the machine.
        hosts: IP addresses and names of a machine; empty for an operator, who cannot listen.
        days: until it expires.

    Raises:
        ContidError: the CA cannot be read, a file is there already, or a name is wrong.
    """
    require_extra("certificates of a fleet", "cryptography")
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID

    path = folder / f"{name}.pem"
    _check_new(name, path)
    issuer, issuer_key = _read_ca(ca)
    key = ec.generate_private_key(ec.SECP256R1())
    builder = _builder(f"{MACHINE}{name}" if hosts else name, key, days, (issuer.subject, issuer_key))
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    if hosts:
        uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        builder = builder.add_extension(x509.SubjectAlternativeName(list(map(_host, hosts))), critical=False)
    builder = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False)
    return _write(path, builder, key, issuer_key)


def check_validity(path: Path) -> None:
    """Refuse a certificate that has expired; without the package Zenoh refuses it, with less detail.

    Raises:
        ContidError: with the date.
    """
    if find_spec("cryptography") is None:
        return
    from cryptography import x509

    try:
        end = x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
    except (OSError, ValueError) as error:
        raise ContidError(f"{path}: no certificate (PEM): {error}") from error
    if end < datetime.datetime.now(datetime.UTC):
        raise ContidError(f"{path}: expired at {end:%Y-%m-%d %H:%M} UTC; `contid fleet cert` makes a new one")


def _check_new(name: str, path: Path) -> None:
    """Refuse a wrong name, and to replace a certificate or its key."""
    if not is_name(name):
        raise ContidError(f"{name!r} is no name: {NAME_RULE}")
    for each in (path, path.with_suffix(".key")):
        if each.exists():
            raise ContidError(f"{each}: exists; it is not replaced, remove it or give another folder")


def _builder(
    common_name: str,
    key: ec.EllipticCurvePrivateKey,
    days: float,
    issuer: tuple[x509.Name, ec.EllipticCurvePrivateKey] | None = None,
) -> x509.CertificateBuilder:
    """A certificate of a key, signed by an issuer; without one, a CA that is its own."""
    from cryptography import x509

    now = datetime.datetime.now(datetime.UTC)
    end = now + datetime.timedelta(days=days)
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, common_name)])
    ca = issuer is None
    issuer_name, issuer_key = issuer or (subject, key)
    usage = x509.KeyUsage(
        digital_signature=not ca,
        key_cert_sign=ca,
        crl_sign=ca,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer_name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False
        )
        .add_extension(x509.BasicConstraints(ca=ca, path_length=0 if ca else None), critical=True)
        .add_extension(usage, critical=True)
        .not_valid_before(min(now, end) - EARLIER)
        .not_valid_after(end)
    )


def _host(host: str) -> x509.GeneralName:
    from cryptography import x509

    if (address := ip_address(host)) is not None:
        return x509.IPAddress(address)
    if not is_host_name(host):
        raise ContidError(f"{host!r}: an IP address or a host name is expected")
    return x509.DNSName(host)


def _read_ca(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    try:
        certificate = x509.load_pem_x509_certificate((folder / CA_CERTIFICATE).read_bytes())
        key = serialization.load_pem_private_key((folder / CA_KEY).read_bytes(), None)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no certificate and key"
        raise ContidError(f"{folder}: no CA there ({reason}); `contid fleet init` makes one") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != certificate.public_key():
        raise ContidError(f"{folder}: {CA_KEY} is not the key of {CA_CERTIFICATE}")
    return certificate, key


def _write(
    path: Path,
    builder: x509.CertificateBuilder,
    key: ec.EllipticCurvePrivateKey,
    issuer_key: ec.EllipticCurvePrivateKey,
) -> Path:
    from cryptography.hazmat.primitives import hashes, serialization

    certificate = builder.sign(issuer_key, hashes.SHA256())
    pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    written: list[Path] = []
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # No other user may read it between its creation and a chmod either.
        descriptor = os.open(path.with_suffix(".key"), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        written = [path.with_suffix(".key"), path]
        with os.fdopen(descriptor, "wb") as file:
            file.write(pem)
        path.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    except OSError as error:
        for each in written:  # half a pair would refuse the next attempt
            each.unlink(missing_ok=True)
        raise ContidError(f"{error.filename or path}: cannot write it: {error.strerror}") from error
    return path
