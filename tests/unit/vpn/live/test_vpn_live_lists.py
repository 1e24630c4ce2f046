"""Which list of revoked certificates may take the place of which: with OpenSSL, as the server has it."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_server
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import run
from atlantis_netcfg.vpn import pki

NOW = datetime.now(UTC)
CA = pki.new_ca("test-ca", NOW)
NAMESAKE = pki.new_ca("test-ca", NOW)
OTHER = pki.new_ca("other-ca", NOW)
SERIAL = pki.new_serial()


def read(folder: Path, pem: bytes) -> vpn_server.Crl | None:
    (folder / "ca.crt").write_text(pki.cert_pem(CA.certificate))
    (folder / "crl.pem").write_bytes(pem)
    return vpn_server.read(str(folder / "crl.pem"), str(folder / "ca.crt"), run)


def listed(number: int = 7, ca: pki.Ca = CA, at: datetime = NOW, days: int = 90) -> bytes:
    return pki.new_crl(ca, [pki.RevokedSerial(SERIAL, at)], number, at, days)


def test_revocation_list_fields_are_read(tmp_path: Path) -> None:
    found = read(tmp_path, listed())
    assert found is not None
    assert (found.number, found.is_signed) == (7, True)
    assert found.ends - found.begins == timedelta(days=90).total_seconds()
    assert abs(found.begins - NOW.timestamp()) <= timedelta(days=2).total_seconds()
    assert vpn_server.accept(found, None, NOW.timestamp()) == found
    assert vpn_server.accept(found, found, NOW.timestamp()) == found


@pytest.mark.parametrize("ca", [NAMESAKE, OTHER], ids=["of the same name", "of another name"])
def test_list_of_another_authority_is_refused(tmp_path: Path, ca: pki.Ca) -> None:
    found = read(tmp_path, listed(ca=ca))
    assert found is not None
    assert not found.is_signed
    with pytest.raises(ModuleError, match="from another authority"):
        vpn_server.accept(found, None, NOW.timestamp())


@pytest.mark.parametrize("pem", [b"", b"no list\n", listed()[:200]], ids=["empty", "text", "cut"])
def test_invalid_list_is_refused(tmp_path: Path, pem: bytes) -> None:
    assert read(tmp_path, pem) is None
    with pytest.raises(ModuleError, match="cannot be read"):
        vpn_server.accept(None, None, NOW.timestamp())


@pytest.mark.parametrize(
    ("number", "day", "words"),
    [
        (6, 1, "number 6, but the server has number 7"),
        (8, -3, "is not valid yet: nobody could connect"),
        (8, 91, "has expired: nobody could connect"),
    ],
)
def test_harmful_list_is_refused(tmp_path: Path, number: int, day: int, words: str) -> None:
    old, new = read(tmp_path, listed(7)), read(tmp_path, listed(number))
    with pytest.raises(ModuleError, match=words):
        vpn_server.accept(new, old, (NOW + timedelta(days=day)).timestamp())


def test_list_number_is_ignored_beside_a_list_of_another_authority(tmp_path: Path) -> None:
    old, new = read(tmp_path, listed(9, NAMESAKE)), read(tmp_path, listed(1))
    assert vpn_server.accept(new, old, NOW.timestamp()) == new


A, B = (pki.RevokedSerial(pki.new_serial(), NOW) for _ in range(2))


def revoking(number: int, *some: pki.RevokedSerial) -> bytes:
    return pki.new_crl(CA, some, number, NOW)


def test_revoked_serials_are_read(tmp_path: Path) -> None:
    found = read(tmp_path, revoking(7, A, B))
    assert found is not None
    assert {int(one, 16) for one in found.serials} == {A.serial, B.serial}
    none = read(tmp_path, revoking(7))
    assert none is not None
    assert none.serials == frozenset()


@pytest.mark.parametrize(
    ("new", "words"),
    [
        (revoking(7, B), "has number 7 like the server's, but differs from it"),
        (revoking(7, A, B), "has number 7 like the server's, but differs from it"),
        (revoking(8, B), "lacks 1 of the certificates that are revoked on the server"),
        (revoking(8), "lacks 1 of the certificates that are revoked on the server"),
        (revoking(6, A, B), "has number 6, but the server has number 7"),
    ],
    ids=["same number", "same number and more", "lacks one", "lacks all", "lower number"],
)
def test_a_list_of_a_restored_authority_is_refused(tmp_path: Path, new: bytes, words: str) -> None:
    old = read(tmp_path, revoking(7, A))
    with pytest.raises(ModuleError, match=words) as refused:
        vpn_server.accept(read(tmp_path, new), old, NOW.timestamp())
    assert "a revoked member could connect again" in refused.value.message


@pytest.mark.parametrize("more", [(), (B,)], ids=["the same", "one more"])
def test_successor_list_is_accepted(tmp_path: Path, more: tuple[pki.RevokedSerial, ...]) -> None:
    old, new = read(tmp_path, revoking(7, A)), read(tmp_path, revoking(8, A, *more))
    assert vpn_server.accept(new, old, NOW.timestamp()) == new
    assert vpn_server.accept(old, old, NOW.timestamp()) == old
