"""A record that was changed, shortened or put back: what `audit` and `status` find, and what signing refuses."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zlib import crc32

import pytest
from authority_stand import NAMES, PASSPHRASE, Stand, stand, wish
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.authority.ledger_session import Head, read_head
from atlantis_netcfg.vpn.authority.model import CorruptAuthorityError
from atlantis_netcfg.vpn.ledger import LedgerState, digest
from atlantis_netcfg.vpn.reports import audit

Rows = list[dict[str, object]]


@pytest.fixture
def made(tmp_path: Path) -> Stand:
    """Two members, one of them revoked and seen before that; a backup of the folder lies beside it."""
    found = stand(tmp_path)
    found.issue("a")
    shutil.copytree(found.folder, tmp_path / "backup")
    found.issue("b")
    with found.signing() as signer:
        signer.revoke(["iqua-a"], "stolen")
    found.authority.record_sessions({"iqua-b": datetime.now(UTC)})
    return found


def chained(edit: Callable[[Rows], Rows]) -> Callable[[Path], None]:
    """Change the rows of the ledger, and make numbers, checksums and hashes anew: nothing in it tells that."""

    def do(folder: Path) -> None:
        path, previous, lines = folder / "ledger.jsonl", "0" * 64, []
        for number, row in enumerate(edit([json.loads(line) for line in path.read_text().splitlines()]), start=1):
            row.pop("crc")
            body = json.dumps({**row, "line": number, "previous": previous}, separators=(",", ":")).encode()[:-1]
            lines.append(body + b',"crc":"%08x"}\n' % crc32(body))
            previous = digest(lines[-1])
        path.write_bytes(b"".join(lines))

    return do


def rows_of(kind: str, rows: Rows) -> Rows:
    return [row for row in rows if row["kind"] == kind]


def without(kind: str) -> Callable[[Rows], Rows]:
    return lambda rows: [row for row in rows if row["kind"] != kind or rows_of(kind, rows)[-1] is not row]


def said_otherwise(rows: Rows) -> Rows:
    rows_of("revoked", rows)[-1]["reason"] = "lent"
    return rows


def by_another(rows: Rows) -> Rows:
    for row in rows:
        row["who"] = "somebody@elsewhere"
    return rows


def another_address(rows: Rows) -> Rows:
    rows_of("issued", rows)[-1]["address"] = "10.8.16.77"
    return rows


def another_serial(rows: Rows) -> Rows:
    rows_of("issued", rows)[-1]["serial"] = "abc"
    return rows


def revoked_at_the_end(rows: Rows) -> Rows:
    return [*rows, {**rows_of("revoked", rows)[-1], "common_name": "iqua-b"}]


def shorter(lines: int) -> Callable[[Path], None]:
    def do(folder: Path) -> None:
        path = folder / "ledger.jsonl"
        path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[:-lines]))

    return do


def put_back(*names: str) -> Callable[[Path], None]:
    def do(folder: Path) -> None:
        for name in names:
            shutil.copy(folder.parent / "backup" / name, folder / name)

    return do


def removed(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).unlink()


def other_head(folder: Path) -> None:
    """Of a shorter ledger, with the signature of the longer one."""
    shorter(5)(folder)
    lines = (folder / "ledger.jsonl").read_bytes().splitlines()
    head = json.loads((folder / "ledger.head").read_text())
    (folder / "ledger.head").write_text(json.dumps({**head, "line": len(lines), "sha256": digest(lines[-1])}))


def other_ca(folder: Path) -> None:
    other = pki.new_ca("ATLANTIS VPN other", datetime.now(UTC))
    (folder / "ca.crt").write_text(pki.cert_pem(other.certificate))


def other_kind_of_ca(folder: Path) -> None:
    """With a key that none of ours has."""
    key, name, now = (
        Ed25519PrivateKey.generate(),
        pki.load_cert((folder / "ca.crt").read_text()).subject,
        datetime.now(UTC),
    )
    builder = x509.CertificateBuilder(name, name, key.public_key(), 1, now, now + timedelta(days=9))
    (folder / "ca.crt").write_text(pki.cert_pem(builder.sign(key, None)))


def other_server(folder: Path) -> None:
    shutil.copy(folder / "certs" / "iqua-b.pem", folder / "server" / "server.crt")


MANIPULATIONS: dict[str, tuple[Callable[[Path], None], str]] = {
    "the last lines are gone": (shorter(2), "its end is missing, or it is an old copy"),
    "all but the founding is gone": (lambda folder: shorter(_lines(folder) - 3)(folder), "its end is missing"),
    "a revocation is gone": (chained(without("revoked")), "are not those that were signed on"),
    "a revocation says another reason": (chained(said_otherwise), "are not those that were signed on"),
    "it was somebody else": (chained(by_another), "are not those that were signed on"),
    "a member has another address": (chained(another_address), "are not those that were signed on"),
    "a certificate has another serial": (
        chained(another_serial),
        "in the ledger was not signed like this by this authority",
    ),
    "a hand-out is gone": (chained(without("delivered")), "are not those that were signed on"),
    "somebody is revoked without the key": (
        chained(revoked_at_the_end),
        (
            "of the ledger must be signed by the CA "
            "key but is not: a command was killed at its end, or something else wrote the line"
        ),
    ),
    "the ledger is an old one": (put_back("ledger.jsonl"), "its end is missing, or it is an old copy"),
    "ledger and head are old": (put_back("ledger.jsonl", "ledger.head"), "the ledger is an old copy"),
    "ledger, head and list are old": (
        put_back("ledger.jsonl", "ledger.head", "crl.pem"),
        "certs/iqua-b.pem is not in the record",
    ),
    "the list is an old one": (put_back("crl.pem"), "which is revoked: provision vpn sync --sign"),
    "the head is gone": (removed("ledger.head"), "the length of the ledger is not known"),
    "the head is an old one": (
        put_back("ledger.head"),
        (
            "of the ledger must be signed by the CA key but is not: a "
            "command was killed at its end, or something else wrote the line"
        ),
    ),
    "the head is of another ledger": (other_head, "ledger.head is not signed by this authority"),
    "a certificate is gone": (removed("certs/iqua-b.pem"), "certs/iqua-b.pem is missing"),
    "another certificate is the server's": (other_server, "server/server.crt is not the certificate that was recorded"),
    "the authority is another one": (other_ca, "ca.crt is not the certificate authority of the ledger"),
    "the authority has a key of another kind": (
        other_kind_of_ca,
        "ca.crt is not the certificate authority of the ledger",
    ),
}
"""What is done, and a part of what is said."""
REFUSED = {name for name in MANIPULATIONS if "gone" in name or "old" in name or "head" in name} - {
    *("the list is an old one", "a certificate is gone", "the head is an old one"),
    *("ledger and head are old", "ledger, head and list are old"),
}
"""With these nothing is signed. What is left is told, and put in order, or is refused by the server."""


def _lines(folder: Path) -> int:
    return len((folder / "ledger.jsonl").read_bytes().splitlines())


def test_intact_ledger_has_no_problems(made: Stand) -> None:
    assert made.authority.check() == []
    found = audit(made.authority, None, None)
    assert found.broken == ()
    first, second, later, unchecked = found.words
    lines = _lines(made.folder)
    assert first.startswith(f"{lines} entries in all: the first {lines - 1} match the signature of the CA key of ")
    assert second == f"the certificates and revocation list {made.authority.membership().crl_number} agree with them"
    assert later == f"entries after line {lines - 1} are chained to them, but not signed"
    assert "this command does not check whether this is the newest copy" in unchecked


@pytest.mark.parametrize("name", MANIPULATIONS)
def test_each_manipulation_is_detected(name: str, made: Stand) -> None:
    do, said = MANIPULATIONS[name]
    do(made.folder)
    found = audit(made.authority, None, None)
    assert found.broken
    assert found.words == ()
    assert said in "\n".join(map(str, found.broken))
    assert said in "\n".join(made.authority.check()), "`status` tells it too"


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_manipulated_authority_signs_nothing(name: str, made: Stand) -> None:
    MANIPULATIONS[name][0](made.folder)
    before = {path: path.read_bytes() for path in made.folder.rglob("*") if path.is_file() and path.name != "lock"}
    with pytest.raises(CorruptAuthorityError) as refused, made.signing():
        pass
    assert "restore ledger.jsonl and ledger.head" in str(refused.value.hint)
    assert {path: path.read_bytes() for path in before} == before


def test_complete_older_copy_is_consistent_but_detectable_from_outside(made: Stand) -> None:
    """Nothing on this computer tells that there is a newer one: the server does."""
    backup = Authority.open(made.folder.parent / "backup")
    assert backup.check() == []
    assert "this command does not check whether this is the newest copy" in audit(backup, None, None).words[-1]
    assert backup.beyond(made.authority.crl()) is not None
    assert made.authority.beyond(backup.crl()) is None


def test_ledger_signature_is_read_once_and_only_from_our_ca(made: Stand, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[Path] = []

    def reading(folder: Path, ca: x509.Certificate, fold: LedgerState) -> Head:
        looked.append(folder)
        return read_head(folder, ca, fold)

    monkeypatch.setattr("atlantis_netcfg.vpn.authority.ledger_session.read_head", reading)
    assert made.authority.agreement().problems == ()
    assert looked == [made.folder]
    other_kind_of_ca(made.folder)
    assert made.authority.agreement().signed_lines == 0
    assert looked == [made.folder], "another CA's key says nothing about it"


def test_every_use_of_the_ca_key_signs_the_ledger(tmp_path: Path) -> None:
    made = stand(tmp_path)
    made.issue("a")
    assert audit(made.authority, None, None).words[0].startswith(f"{_lines(made.folder)} entries in all: the first ")
    with suppress(KeyboardInterrupt), made.signing() as signer:
        signer.issue([wish("b")], made.deliver)
        raise KeyboardInterrupt
    assert made.authority.agreement().signed_lines == _lines(made.folder)
    again = Authority.init(made.folder, PASSPHRASE, NAMES, "founder", "vault")
    assert again.agreement().signed_lines == _lines(made.folder)
