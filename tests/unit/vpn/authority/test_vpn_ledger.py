"""Lines that are torn, changed, lost or put in: what is cut off, what is refused, and what is said."""

import base64
import errno
import os
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path
from typing import get_args

import authority_stand
import pytest
from authority_stand import Stand

from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.identity import KeyType, MemberKind, MemberLink, Wrap
from atlantis_netcfg.vpn.ledger import (
    CorruptLedgerError,
    Ledger,
    LedgerEntry,
    LedgerError,
    LedgerState,
    first_lines,
    read,
    records,
)
from atlantis_netcfg.vpn.ledger.file import GENESIS, digest, encode, parse, utc_now

NOW = datetime(2026, 11, 22, 7, 30, tzinfo=UTC)
YEAR = NOW + timedelta(days=365)
ISSUED = records.IssueRecord(
    name="iqua-sparus2",
    device_kind=MemberKind.ROBOT,
    partner="iqua",
    device="sparus2",
    address=IPv4Address("10.8.16.1"),
    link=MemberLink.LTE,
    vehicle="sparus",
    common_name="iqua-sparus2",
    serial=2**158 + 1,
    sha256="ab" * 32,
    not_before=NOW,
    not_after=YEAR,
    wrap=Wrap.TLS_CRYPT_V2,
    key=KeyType.EC,
    der="QUJD",
)
EVERY: tuple[records.Record, ...] = (
    records.FoundingRecord(ca_common_name="CA", ca_sha256="00", ca_not_after=YEAR, sealed_by="age"),
    records.ServerIssueRecord(
        common_name="server-1",
        dns=("vpn.example",),
        addresses=(IPv4Address("192.0.2.1"),),
        serial=1,
        sha256="00",
        not_before=NOW,
        not_after=YEAR,
    ),
    records.BeginRecord(command="issue", names=("iqua-sparus2",)),
    ISSUED,
    records.DeliveryRecord(common_name="iqua-sparus2", path="handouts/x", sha256="cd" * 32),
    records.CommitRecord(),
    records.SightingRecord(common_name="iqua-sparus2", last=NOW),
    records.SupersedeRecord(common_name="iqua-sparus2", by="iqua-sparus2.2"),
    records.RevocationRecord(common_name="iqua-sparus2", reason="lost"),
    records.RolledBack(common_names=("iqua-sparus2",)),
    records.SettlementRecord(common_name="iqua-sparus2"),
    records.PublicationRecord(number=2, sha256="ef" * 32, next_update=YEAR, revoked=1),
    records.TakeoverRecord(serials=(2**158 + 3, 7)),
    records.ClockTrustRecord(before=NOW),
)


def whole(path: Path, *some: records.Record) -> bytes:
    data = first_lines(some or EVERY, "me", "op", NOW)
    path.write_bytes(data)
    return data


def test_every_record_round_trips(tmp_path: Path) -> None:
    assert {type(record) for record in EVERY} == set(get_args(get_args(records.Record)[0]))
    whole(tmp_path / "ledger")
    reading = read(tmp_path / "ledger").sound()
    assert tuple(entry.record for entry in reading.entries) == EVERY
    assert [entry.number for entry in reading.entries] == list(range(1, len(EVERY) + 1))
    assert {(entry.at, entry.who, entry.operation) for entry in reading.entries} == {(NOW, "me", "op")}


def test_every_record_has_a_description_and_can_be_applied() -> None:
    fold = LedgerState()
    for number, record in enumerate(EVERY, start=1):
        entry = LedgerEntry(number, NOW, "me", "op", record)
        assert entry.words.isprintable()
        assert entry.facts().items() >= {"line": number, "who": "me", "operation": "op", "kind": record.kind}.items()
        fold.apply(entry)
    assert fold.last == NOW
    assert {utc_now().microsecond % 1000 for _ in range(9)} == {0}


def test_record_fields_do_not_collide_with_line_fields() -> None:
    head = {"line", "at", "who", "operation", "previous", "crc", "words"}
    for record in EVERY:
        assert head.isdisjoint(record.__dataclass_fields__)


def test_every_byte_of_a_line_is_covered_by_the_checksum() -> None:
    line = encode(LedgerEntry(1, NOW, "me", "op", ISSUED), GENESIS).rstrip(b"\n")
    assert parse(line, 1, GENESIS).record == ISSUED
    for place in range(len(line)):
        changed = line[:place] + bytes([line[place] ^ 1]) + line[place + 1 :]
        with pytest.raises(ValueError, match="checksum"):
            parse(changed, 1, GENESIS)


def test_line_out_of_sequence_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ledger"
    lines = whole(path).splitlines(keepends=True)
    other = encode(LedgerEntry(3, NOW, "me", "op", EVERY[4]), digest(lines[0]))
    for wrong, line, why in (
        ([lines[0], *lines[2:]], 2, "lines before it are missing or out of order"),
        ([lines[0], lines[2], lines[1]], 2, "lines before it are missing or out of order"),
        ([*lines[:2], lines[1]], 3, "lines before it are missing or out of order"),
        ([*lines[:2], other, *lines[3:]], 3, "it does not continue the line before it"),
        ([*lines[:2], b"\n", *lines[2:]], 3, "its checksum is wrong"),
        ([*lines[:2], b"\0" * 20 + b"\n"], 3, "its checksum is wrong"),
    ):
        path.write_bytes(b"".join(wrong))
        with pytest.raises(CorruptLedgerError, match=f"line {line} of the ledger is damaged: {why}") as damaged:
            Ledger(path)
        assert str(path) in str(damaged.value)
        assert len(read(path).entries) == line - 1


def test_a_line_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    line = encode(LedgerEntry(1, NOW, "me", "op", records.CommitRecord()), GENESIS)[:-19].replace(
        b"committed", b"teleported"
    )
    from binascii import crc32  # noqa: PLC0415 - a line that nobody writes

    (tmp_path / "ledger").write_bytes(line + b',"crc":"%08x"}\n' % crc32(line))
    assert read(tmp_path / "ledger").damage == (
        "line 1 of the ledger is damaged: this version of the toolkit does not know its type"
    )


def test_record_about_an_unknown_member_is_refused() -> None:
    entry = LedgerEntry(7, NOW, "me", "op", records.RevocationRecord(common_name="iqua-ghost", reason="lost"))
    with pytest.raises(CorruptLedgerError, match="line 7 of the ledger refers to 'iqua-ghost', which was never issued"):
        LedgerState([entry])


def test_torn_last_line_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "ledger"
    first = whole(path, EVERY[0])
    both = whole(path, EVERY[0], ISSUED)
    for end in (len(first) + 1, *range(len(first) + 2, len(both) - 1, 11), len(both) - 1):
        path.write_bytes(both[:end])
        assert read(path).is_torn
        assert len(read(path).sound().entries) == 1
        with Ledger(path) as ledger:
            assert path.read_bytes() == first
            ledger.write([records.CommitRecord()], "me", "op", NOW)
        assert [entry.record for entry in read(path).sound().entries] == [EVERY[0], records.CommitRecord()]


def test_failed_write_is_undone_and_ends_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "ledger"
    before = whole(path)
    write = os.write

    def short(descriptor: int, data: bytes) -> int:
        if len(data) < 40:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, bytes(data)[:40])

    with Ledger(path) as ledger:
        with monkeypatch.context() as patch:
            patch.setattr(os, "write", short)
            with pytest.raises(LedgerError, match=r"the ledger cannot be written: No space left on device \(.*ledger"):
                ledger.write([ISSUED], "me", "op", NOW)
        assert path.read_bytes() == before
        assert not ledger.usable
        with pytest.raises(LedgerError):
            ledger.write([ISSUED], "me", "op", NOW)
    assert path.read_bytes() == before


def test_author_name_is_sanitised_for_the_terminal(tmp_path: Path) -> None:
    data = first_lines([records.CommitRecord()], "me\x1b[2J\n" + "x" * 500, "op", NOW)
    (tmp_path / "ledger").write_bytes(data)
    who = read(tmp_path / "ledger").entries[0].who
    assert who.startswith("me?[2J?xx")
    assert len(who) == 120


def test_batch_is_synced_to_disk_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole(tmp_path / "ledger")
    synced: list[int] = []
    with Ledger(tmp_path / "ledger") as ledger:
        monkeypatch.setattr(os, "fsync", synced.append)
        ledger.write([records.CommitRecord()] * 500, "me", "op", NOW)
        ledger.write([], "me", "op", NOW)
    assert len(synced) == 1
    assert len(read(tmp_path / "ledger").sound().entries) == len(EVERY) + 500


# A ledger from an older backup beside the newer revocation list: nobody who was revoked comes back by that.


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


def test_new_revocation_list_includes_the_previous_serials(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    number = listed(stand).number
    with stand.signing() as signer:
        signer.revoke(["iqua-girona"], "lost as well")
    facts = listed(stand)
    assert facts.serials >= {serial, stand.identities[1].certificate.serial}
    assert facts.number > number


def test_different_list_with_the_last_number_is_reported(tmp_path: Path) -> None:
    stand = authority_stand.stand(tmp_path)
    number = listed(stand).number
    said = {n: stand.authority.beyond(pki.new_crl(stand.ca, [], n, datetime.now(UTC), 9)) for n in (number - 1, number)}
    assert said[number - 1] is None
    assert "like the last one in the record, but a different content" in str(said[number])


def test_serial_known_only_to_the_list_is_reported(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    said = [line for line in stand.authority.check() if "the ledger is an old copy" in line]
    assert said == [
        f"crl.pem contains serial {serial:x}, which is not revoked in the record: the ledger is an old copy"
    ]


def test_recovered_revocation_list_is_signed_once(tmp_path: Path) -> None:
    stand, serial = revoked_and_forgotten(tmp_path)
    for _ in range(2):
        with stand.signing():
            first = listed(stand)
    assert listed(stand) == first
    assert serial in first.serials


def test_damaged_revocation_list_is_replaced(tmp_path: Path) -> None:
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
