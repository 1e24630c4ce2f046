import subprocess
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TypeVar

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from pki_made import NAME, NOW, authority, client, server

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import KeyType

TODAY = datetime.now(UTC)
T = TypeVar("T", bound=x509.ExtensionType)


def extension(certificate: x509.Certificate, kind: type[T]) -> T:
    return certificate.extensions.get_extension_for_class(kind).value


def usage(certificate: x509.Certificate) -> set[str]:
    said = extension(certificate, x509.KeyUsage)
    names = (
        *("digital_signature", "key_encipherment", "key_agreement", "key_cert_sign"),
        *("crl_sign", "content_commitment"),
    )
    return {name for name in names if getattr(said, name)}


def test_ca_certificate_signs_only_devices_and_lists_for_ten_years() -> None:
    ca = authority().certificate
    assert ca.subject == ca.issuer == x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, NAME)])
    assert extension(ca, x509.BasicConstraints) == x509.BasicConstraints(ca=True, path_length=0)
    assert ca.extensions.get_extension_for_class(x509.BasicConstraints).critical
    assert usage(ca) == {"key_cert_sign", "crl_sign"}
    assert ca.not_valid_before_utc == NOW.replace(microsecond=0) - timedelta(days=30)
    assert ca.not_valid_after_utc == NOW.replace(microsecond=0) + timedelta(days=3652)


def test_client_certificate_is_valid_only_for_a_client() -> None:
    made = client(authority())
    assert list(extension(made, x509.ExtendedKeyUsage)) == [ExtendedKeyUsageOID.CLIENT_AUTH]
    assert usage(made) == {"digital_signature"}
    assert made.extensions.get_extension_for_class(x509.BasicConstraints).critical
    assert not extension(made, x509.BasicConstraints).ca
    assert made.subject == x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "iqua-sparus2")])
    assert made.not_valid_before_utc == NOW.replace(microsecond=0) - timedelta(days=1)
    assert made.not_valid_after_utc == NOW.replace(microsecond=0) + timedelta(days=397)
    mine = extension(authority().certificate, x509.SubjectKeyIdentifier)
    assert extension(made, x509.AuthorityKeyIdentifier).key_identifier == mine.digest
    assert extension(made, x509.SubjectKeyIdentifier).digest != mine.digest


def test_server_certificate_contains_its_names() -> None:
    made = server(authority())
    assert list(extension(made, x509.ExtendedKeyUsage)) == [ExtendedKeyUsageOID.SERVER_AUTH]
    names = extension(made, x509.SubjectAlternativeName)
    assert names.get_values_for_type(x509.DNSName) == ["vpn.example.org"]
    assert [str(one) for one in names.get_values_for_type(x509.IPAddress)] == ["192.0.2.1", "10.20.0.4"]
    assert usage(made) == {"digital_signature", "key_agreement"}
    assert made.not_valid_after_utc == NOW.replace(microsecond=0) + timedelta(days=1826)
    assert made.not_valid_before_utc == NOW.replace(microsecond=0) - timedelta(days=30)


def test_required_extensions_are_critical() -> None:
    must = {"BasicConstraints", "KeyUsage"}
    for made in (authority().certificate, server(authority()), client(authority())):
        assert {type(one.value).__name__ for one in made.extensions if one.critical} == must


def test_rsa_server_allows_key_encipherment() -> None:
    key = pki.new_key(KeyType.RSA)
    made = pki.new_server(authority(), key.public_key(), "scc", [], [], pki.new_serial(), NOW)
    assert usage(made) == {"digital_signature", "key_encipherment"}


def test_key_types_are_p256_and_rsa_2048() -> None:
    curve, old = pki.new_key(KeyType.EC), pki.new_key(KeyType.RSA)
    assert isinstance(curve, ec.EllipticCurvePrivateKey)
    assert isinstance(curve.curve, ec.SECP256R1)
    assert isinstance(old, rsa.RSAPrivateKey)
    assert old.key_size == 2048


def test_serials_are_random_and_positive() -> None:
    serials = {pki.new_serial() for _ in range(2000)}
    assert len(serials) == 2000
    assert all(0 < serial < 1 << 159 for serial in serials)
    assert max(serials) >> 156


@pytest.mark.parametrize(
    "name",
    ["", "a\0b", "a/b", "..", "a..", "-a", "a-", "A", "a\n", "a b", "å", "a" * 65, "a=b", "a,b", "a_b", "\u0430bc"],
)
def test_a_name_that_openvpn_would_misread_is_not_signed(name: str) -> None:
    with pytest.raises(pki.InvalidCertificateError, match="is not a valid name for a certificate"):
        client(authority(), name)


def test_ca_name_must_be_plain() -> None:
    with pytest.raises(pki.InvalidCertificateError, match="is not a valid name for a certificate authority"):
        pki.new_ca("a/b", NOW)


def test_certificate_cannot_outlive_the_ca() -> None:
    late = NOW + timedelta(days=3652 - 396)
    with pytest.raises(pki.InvalidCertificateError, match="would outlive") as refused:
        client(authority(), days=397, now=late)
    assert refused.value.hint == "use days=396, or create a new authority"
    assert client(authority(), days=396, now=late).not_valid_after_utc == authority().certificate.not_valid_after_utc


def test_certificate_never_begins_before_the_ca() -> None:
    early = NOW - timedelta(days=29)
    assert server(authority(), early).not_valid_before_utc == authority().certificate.not_valid_before_utc


def test_the_authority_signs_from_its_first_second() -> None:
    first = authority().certificate.not_valid_before_utc
    assert client(authority(), now=first).not_valid_before_utc == first


@pytest.mark.parametrize("days", [-31, 3652])
def test_wrong_clock_is_reported(days: int) -> None:
    with pytest.raises(pki.InvalidCertificateError, match="this computer's date is"):
        client(authority(), days=1, now=NOW + timedelta(days=days))


def test_a_certificate_lasts_a_day_at_least() -> None:
    with pytest.raises(pki.InvalidCertificateError, match="at least one day"):
        client(authority(), days=0)


@pytest.mark.parametrize("serial", [0, -1, 1 << 159])
def test_serial_outside_159_bits_is_refused(serial: int) -> None:
    with pytest.raises(pki.InvalidCertificateError, match="serial"):
        pki.new_client(authority(), authority().key.public_key(), "a", serial, 1, NOW)


def test_issuer_is_verified_by_signature() -> None:
    made = client(authority())
    assert pki.issued_by(made, authority().certificate)
    assert not pki.issued_by(made, authority(nth=2).certificate)
    assert not pki.issued_by(made, authority("ANOTHER").certificate)


def test_ca_round_trips_as_text() -> None:
    ca = authority()
    back = pki.load_ca(pki.cert_pem(ca.certificate), pki.key_pem(ca.key))
    assert back.certificate == ca.certificate
    assert pki.key_pem(back.key) == pki.key_pem(ca.key)
    assert len(pki.sha256(ca.certificate)) == 64


def test_key_of_another_ca_is_refused() -> None:
    with pytest.raises(pki.CorruptKeyError, match="the CA key does not match the CA certificate"):
        pki.load_ca(pki.cert_pem(authority().certificate), pki.key_pem(authority(nth=2).key))


@pytest.mark.parametrize("text", ["", "nothing", "-----BEGIN PRIVATE KEY-----\ncanary\n-----END PRIVATE KEY-----\n"])
def test_invalid_key_is_refused_without_showing_its_text(text: str) -> None:
    with pytest.raises(pki.CorruptKeyError) as refused:
        pki.load_key(Secret(text))
    assert "canary" not in str(refused.value)
    assert refused.value.__cause__ is None
    with pytest.raises(pki.CorruptKeyError, match="not a certificate"):
        pki.load_cert(text)


def test_repr_of_the_ca_does_not_show_its_key() -> None:
    middle = pki.key_pem(authority().key).reveal().splitlines()[1]
    assert middle not in repr(authority())
    assert replace(authority()) == authority()


def test_openssl_verifies_the_certificate_purposes(tmp_path: Path) -> None:
    ca = pki.new_ca(NAME, TODAY)
    (tmp_path / "ca.crt").write_text(pki.cert_pem(ca.certificate))
    for purpose, made in (("sslserver", server(ca, TODAY)), ("sslclient", client(ca, now=TODAY))):
        (tmp_path / f"{purpose}.crt").write_text(pki.cert_pem(made))
    for purpose in ("sslserver", "sslclient"):
        for name in ("sslserver", "sslclient"):
            command = ["openssl", "verify", "-x509_strict", "-CAfile", "ca.crt", "-purpose", purpose, f"{name}.crt"]
            done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
            assert (done.returncode == 0) is (purpose == name), done.stderr
