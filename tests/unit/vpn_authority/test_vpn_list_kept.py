"""A ledger from an older backup beside the newer revocation list: nobody who was revoked comes back by that."""

from __future__ import annotations

import base64
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import authority_stand

from atlantis_netcfg.vpn import pki

if TYPE_CHECKING:
    from pathlib import Path

    from authority_stand import Stand


def listed(stand: Stand) -> pki.CrlFacts:
    pem = (stand.folder / "crl.pem").read_bytes()
    return pki.check_crl(pem, stand.ca.certificate, above=None, now=datetime.now(UTC))


def revoked_and_forgotten(tmp_path: Path) -> tuple[Stand, int]:
    """An authority that has revoked a device, and whose ledger is the one of before; with that device's serial."""
    stand = authority_stand.stand(tmp_path)
    stand.issue("sparus2", "girona")
    before = {name: (stand.folder / name).read_bytes() for name in ("ledger.jsonl", "ledger.head")}
    with stand.signing() as signer:
        signer.revoke(["iqua-sparus2"], "lost")
    for name, data in before.items():
        (stand.folder / name).write_bytes(data)
    return stand, stand.identities[0].certificate.serial


def test_what_a_list_held_the_next_one_holds(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    number = listed(stand).number
    with stand.signing() as signer:
        signer.revoke(["iqua-girona"], "lost as well")
    facts = listed(stand)
    assert facts.serials >= {serial, stand.identities[1].certificate.serial}
    assert facts.number > number


def test_what_only_the_list_knows_is_told(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    said = [line for line in stand.authority.check() if "the ledger is an old copy" in line]
    assert said == [
        f"crl.pem names serial {serial:x}, which the record does not say is revoked: the ledger is an old copy"
    ]


def test_a_list_is_signed_once_for_that(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    for _ in range(2):
        with stand.signing():
            first = listed(stand)
    assert listed(stand) == first
    assert serial in first.serials


def test_a_damaged_list_is_replaced(tmp_path: Path) -> None:
    stand = authority_stand.stand(tmp_path)
    path = stand.folder / "crl.pem"
    pem = path.read_bytes()
    head, *rows, tail = pem.splitlines()
    der = base64.b64decode(b"".join(rows)).replace(b"\x02\x01\x01", b"\x02\x01\x09", 1)
    version_9 = b"\n".join([head, base64.b64encode(der), tail, b""])
    for damaged in (b"", pem[:-40], version_9):
        path.write_bytes(damaged)
        with stand.signing():
            assert listed(stand).serials == frozenset()
