"""An authority for tests, made once a run: who changes anything makes one of their own."""

from datetime import UTC, datetime
from functools import cache
from ipaddress import IPv4Address
from pathlib import Path

from cryptography import x509

from atlantis_netcfg.vpn.identity import KeyType
from atlantis_netcfg.vpn.pki import (
    Ca,
    RevokedSerial,
    cert_pem,
    key_pem,
    new_ca,
    new_client,
    new_crl,
    new_key,
    new_serial,
    new_server,
)

NOW = datetime(2026, 6, 1, 12, 0, 0, 654321, tzinfo=UTC)
NAME = "ATLANTIS VPN"


@cache
def authority(name: str = NAME, nth: int = 1) -> Ca:
    """One of that name; with another `nth` an impostor of the same name."""
    assert nth
    return new_ca(name, NOW)


def client(ca: Ca, common_name: str = "iqua-sparus2", days: int = 397, now: datetime = NOW) -> x509.Certificate:
    return new_client(ca, new_key(KeyType.EC).public_key(), common_name, new_serial(), days, now)


def server(ca: Ca, now: datetime = NOW) -> x509.Certificate:
    names, addresses = ["vpn.example.org"], [IPv4Address("192.0.2.1"), IPv4Address("10.20.0.4")]
    return new_server(ca, new_key(KeyType.EC).public_key(), "scc", names, addresses, new_serial(), now)


def crl(
    ca: Ca, number: int = 2, now: datetime = NOW, days: int = 90, serials: tuple[int, ...] = (7, 1 << 158)
) -> bytes:
    return new_crl(ca, [RevokedSerial(serial, NOW) for serial in serials], number, now, days)


def entity(folder: Path, ca: Ca, name: str, kind: KeyType = KeyType.EC, *, serves: bool = False) -> x509.Certificate:
    """A key and a certificate that are good today, written as NAME.key and NAME.crt."""
    key, now = new_key(kind), datetime.now(UTC)
    if serves:
        made = new_server(ca, key.public_key(), name, ["vpn.example.org"], [], new_serial(), now)
    else:
        made = new_client(ca, key.public_key(), name, new_serial(), 30, now)
    (folder / f"{name}.crt").write_text(cert_pem(made))
    (folder / f"{name}.key").write_text(key_pem(key).reveal())
    return made
