"""Which list of revoked certificates may take the place of which: with OpenSSL, as the server has it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_list
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.programs import run
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.refused import Refused
from atlantis_netcfg.vpn import pki

if TYPE_CHECKING:
    from pathlib import Path

NOW = datetime.now(UTC)
CA = pki.new_ca("test-ca", NOW)
NAMESAKE = pki.new_ca("test-ca", NOW)
OTHER = pki.new_ca("other-ca", NOW)


def read(folder: Path, pem: bytes) -> vpn_list.Crl | None:
    (folder / "ca.crt").write_text(pki.cert_pem(CA.certificate))
    (folder / "crl.pem").write_bytes(pem)
    return vpn_list.read(str(folder / "crl.pem"), str(folder / "ca.crt"), run)


def listed(number: int = 7, ca: pki.Ca = CA, at: datetime = NOW, days: int = 90) -> bytes:
    return pki.new_crl(ca, [pki.RevokedSerial(pki.new_serial(), at)], number, at, days)


def test_a_list_is_read_as_openssl_reads_it(tmp_path: Path) -> None:
    found = read(tmp_path, listed())
    assert found is not None
    assert (found.number, found.signed) == (7, True)
    assert found.ends - found.begins == timedelta(days=90).total_seconds()
    assert abs(found.begins - NOW.timestamp()) <= timedelta(days=2).total_seconds()
    assert vpn_list.accept(found, None, NOW.timestamp()) == found
    assert vpn_list.accept(found, found, NOW.timestamp()) == found


@pytest.mark.parametrize("ca", [NAMESAKE, OTHER], ids=["of the same name", "of another name"])
def test_a_list_of_another_authority_is_known(tmp_path: Path, ca: pki.Ca) -> None:
    found = read(tmp_path, listed(ca=ca))
    assert found is not None
    assert not found.signed
    with pytest.raises(Refused, match="of another authority"):
        vpn_list.accept(found, None, NOW.timestamp())


@pytest.mark.parametrize("pem", [b"", b"no list\n", listed()[:200]], ids=["empty", "text", "cut"])
def test_what_is_no_list_is_none(tmp_path: Path, pem: bytes) -> None:
    assert read(tmp_path, pem) is None
    assert vpn_list.number(pem) is None
    with pytest.raises(Refused, match="cannot be read"):
        vpn_list.accept(None, None, NOW.timestamp())


@pytest.mark.parametrize(
    ("number", "day", "words"),
    [
        (6, 1, "number 6, and the server has number 7"),
        (8, -3, "is not valid yet: nobody could connect"),
        (8, 91, "has expired: nobody could connect"),
    ],
)
def test_a_list_that_would_harm_is_refused(tmp_path: Path, number: int, day: int, words: str) -> None:
    old, new = read(tmp_path, listed(7)), read(tmp_path, listed(number))
    with pytest.raises(Refused, match=words):
        vpn_list.accept(new, old, (NOW + timedelta(days=day)).timestamp())


def test_a_number_says_nothing_beside_a_list_of_another_authority(tmp_path: Path) -> None:
    old, new = read(tmp_path, listed(9, NAMESAKE)), read(tmp_path, listed(1))
    assert vpn_list.accept(new, old, NOW.timestamp()) == new


@settings(max_examples=50)
@given(st.integers(min_value=1, max_value=2**159 - 1))
def test_the_number_is_found_without_openssl_too(number: int) -> None:
    assert vpn_list.number(listed(number)) == number
