"""The ledger open for writing, its signed head, server certificate and revocation list."""

from __future__ import annotations

import base64
import json
import secrets
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import TYPE_CHECKING, Self

from cryptography.exceptions import UnsupportedAlgorithm

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import identity, pki
from atlantis_netcfg.vpn.authority import model
from atlantis_netcfg.vpn.ledger import FILE, Ledger, LedgerState, Record, utc_now
from atlantis_netcfg.vpn.ledger.records import (
    BeginRecord,
    ClockTrustRecord,
    CommitRecord,
    PublicationRecord,
    RolledBack,
    ServerIssueRecord,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from cryptography import x509


SLACK = timedelta(minutes=2)
"""How far a time server may set back a clock: records meanwhile get the time of the last one."""


class LedgerSession:
    """The ledger open for writing, under the lock. Raises CorruptLedgerError, LedgerError."""

    def __init__(self, folder: Path, who: str) -> None:
        self._ledger = Ledger(folder / FILE)
        self._who = who
        self.state = LedgerState(self._ledger.entries)

    @property
    def usable(self) -> bool:
        """True if it can still be written to."""
        return self._ledger.usable

    @property
    def digests(self) -> Sequence[str]:
        """Hash of each line."""
        return self._ledger.digests

    def now(self) -> datetime:
        """Return the time to record and sign: this computer's, but never before the last record."""
        now = utc_now()
        return now if self.state.last is None else max(now, self.state.last)

    def check_clock(self, *, is_trusted: bool) -> None:
        """Raise ClockBehind if the clock is before the last record; `is_trusted`: record that it is right."""
        now, last = utc_now(), self.state.last
        if last is None or now >= last - SLACK:
            return
        if not is_trusted:
            raise model.ClockBehind(
                f"the clock of this computer says {arg(now):%Y-%m-%d %H:%M} UTC, but the last record of the authority "
                f"is of {arg(last):%Y-%m-%d %H:%M} UTC: a signature made now could be refused or expire too early",
                hint="set the clock, then run the same command again; if the clock is right and was wrong before: "
                "add clock=right",
            )
        self._apply([ClockTrustRecord(before=last)], new_operation(), now)

    def write(self, records: Sequence[Record], operation: str) -> None:
        """Write records to disk, all or none as far as a disk can. Raises LedgerError."""
        self._apply(records, operation, self.now())

    def close(self) -> None:
        """Close the ledger; no write is pending."""
        self._ledger.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _apply(self, records: Sequence[Record], operation: str, now: datetime) -> None:
        for entry in self._ledger.write(records, self._who, operation, now):
            self.state.apply(entry)


def new_operation() -> str:
    """Return a new id shared by the records of one command."""
    return secrets.token_hex(6)


HEAD_FILE = "ledger.head"
NONE_SIGNED = (
    "the length of the ledger is not recorded: an older version created this authority, and did not sign "
    "the end of the ledger"
)
_RESTORE = (
    "do not sign anything; restore ledger.jsonl and ledger.head from the newest backup of the authority, "
    "both from the same one"
)
_WHAT = b"head of the record of an ATLANTIS VPN authority\n"
"""Prefix of the signed data: it cannot be mistaken for a certificate or a list."""


@dataclass(frozen=True, slots=True)
class Head:
    """The last signed position of the ledger.

    It is the last line of the ledger when a command last had the CA key open. The hash chain of the lines needs no key:
    anybody who may write the file can make a new chain, or remove its end. A head cannot be made without the key. Lines
    written without a key come after it: sightings of members, and confirmed revocations.

    An authority created by an older version has no head until a command opens its CA key. If lines are cut off before
    that, only the certificates, the list and the server show it. Whoever cuts lines off later must also remove the head
    and every line since, which restores an old copy: the server shows that.
    """

    line: int
    digest: str
    """SHA-256 of that line; through the chain it covers all lines before."""
    at: datetime

    def hold(self, digests: Sequence[str]) -> None:
        """Raise CorruptAuthorityError unless these lines begin with the signed ones."""
        on = f"{self.at:%Y-%m-%d %H:%M} UTC"
        if len(digests) < self.line:
            raise model.CorruptAuthorityError(
                f"the ledger has {arg(len(digests))} lines, but {arg(self.line)} were signed on {arg(on)}: its end is "
                "missing, or it is an old copy",
                hint=_RESTORE,
            )
        if self.line and digests[self.line - 1] != self.digest:
            raise model.CorruptAuthorityError(
                f"the first {arg(self.line)} lines of the ledger are not those that were signed on {arg(on)}",
                hint=_RESTORE,
            )


_NONE = Head(0, "", datetime.min.replace(tzinfo=UTC))


def new_head(ca: pki.Ca, line: int, digest: str, at: datetime) -> bytes:
    """Return the content of the head file, with signature."""
    values = {"line": line, "sha256": digest, "at": at.isoformat()}
    signature = base64.b64encode(pki.sign(ca.key, _text(values))).decode("ascii")
    return json.dumps({**values, "signature": signature}).encode() + b"\n"


def sign_head(folder: Path, ledger_session: LedgerSession, ca: pki.Ca) -> None:
    """Sign the last line, unless already signed. Raises AuthorityError."""
    line = len(ledger_session.digests)
    if read_head(folder, ca.certificate, ledger_session.state).line < line:
        with model.os_errors_as("the head of the record cannot be written"):
            write_atomically(folder / HEAD_FILE, new_head(ca, line, ledger_session.digests[-1], ledger_session.now()))


def read_head(folder: Path, ca: x509.Certificate, state: LedgerState) -> Head:
    """Read the head; line 0 for a folder of an older version. Raises CorruptAuthorityError, AuthorityError."""
    with model.os_errors_as("the head of the record cannot be read"):
        try:
            data = (folder / HEAD_FILE).read_bytes()
        except FileNotFoundError:
            if state.founded is not None and not state.founded.heads:
                return _NONE
            raise model.CorruptAuthorityError(
                f"{arg(HEAD_FILE)} is missing: the length of the ledger is not known", hint=_RESTORE
            ) from None
    try:
        key = ca.public_key()
        result = json.loads(data)
        signature = base64.b64decode(result.pop("signature"), validate=True)
        head = Head(int(result["line"]), str(result["sha256"]), datetime.fromisoformat(result["at"]))
        # Somebody else's CA may have a key of another kind than ours.
        is_signed = isinstance(key, pki.PublicKey) and pki.is_signed(key, _text(result), signature) and head.line > 0
    except (ValueError, KeyError, TypeError, AttributeError, UnsupportedAlgorithm):
        is_signed = False
    if not is_signed:
        raise model.CorruptAuthorityError(
            f"{arg(HEAD_FILE)} is not signed by this authority: it was changed", hint=_RESTORE
        )
    return head


def _text(values: dict[str, object]) -> bytes:
    return _WHAT + json.dumps(values, sort_keys=True, separators=(",", ":")).encode()


SOON = timedelta(days=90)
"""A server certificate that expires earlier than this is replaced on request."""


def new_server_certificate(
    ca: pki.Ca, names: model.ServerNames, now: datetime
) -> tuple[dict[str, bytes], ServerIssueRecord]:
    """Create a server key and certificate; return them as files, with their record."""
    key = pki.new_key(identity.KeyType.EC)
    certificate = pki.new_server(
        ca, key.public_key(), names.common_name, names.dns, names.addresses, pki.new_serial(), now
    )
    record = ServerIssueRecord(
        common_name=names.common_name,
        dns=names.dns,
        addresses=names.addresses,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
    )
    files = {
        model.SERVER_KEY: pki.key_pem(key).reveal().encode(),
        model.SERVER_CERT: pki.cert_pem(certificate).encode(),
    }
    return files, record


def names_of(record: ServerIssueRecord) -> model.ServerNames:
    """Return the names in a server certificate."""
    return model.ServerNames(record.common_name, record.dns, record.addresses)


def needs_another(record: ServerIssueRecord | None, names: model.ServerNames, now: datetime) -> bool:
    """Return True if the server certificate is missing, is for other names, or expires soon."""
    return record is None or names_of(record) != names or record.not_after - now < SOON


def is_sound(folder: Path, record: ServerIssueRecord) -> bool:
    """Return True if the files are the recorded certificate and its key; they are written one after the other."""
    try:
        certificate = pki.load_cert((folder / model.SERVER_CERT).read_text(encoding="ascii"))
        key = pki.load_key(Secret((folder / model.SERVER_KEY).read_text(encoding="ascii")))
    except (FileNotFoundError, ValueError, pki.CorruptKeyError):
        return False
    return pki.sha256(certificate) == record.sha256 and certificate.public_key() == key.public_key()


@dataclass(frozen=True)
class SigningSession:
    """Resources of one command that signs.

    The folder, the ledger open for writing, and the CA with its key; held under the lock.
    """

    folder: Path
    ledger: LedgerSession
    ca: pki.Ca

    @cached_property
    def ca_pem(self) -> str:
        """The CA's certificate."""
        return pki.cert_pem(self.ca.certificate)

    def wrap_key(self, wrap: identity.Wrap, common_name: str) -> Secret:
        """Return the key of a member's control channel."""
        if wrap is identity.Wrap.TLS_CRYPT:
            return self._shared_key
        return pki.client_key(self._server_key, f"cn={common_name}".encode())

    def publish(self, operation: str, also: pki.CrlFacts | None = None) -> bytes:
        """Publish the list for the recorded state, plus the entries of `also`."""
        return publish_crl(self.folder, self.ledger, self.ca, operation, also)

    def serve(self, names: model.ServerNames) -> None:
        """Create a new key and certificate for the server."""
        operation = new_operation()
        files, record = new_server_certificate(self.ca, names, self.ledger.now())
        self.ledger.write([BeginRecord(command="serve"), record], operation)
        with model.os_errors_as("the server's certificate cannot be written"):
            for name, data in files.items():
                write_atomically(self.folder / name, data)
        self.ledger.write([CommitRecord()], operation)

    def recover(self, *, was_killed: bool) -> None:
        """Complete or withdraw what earlier commands left; `was_killed`: the last one was killed.

        Problems are detected from the files, not remembered, since this command may be killed as well.
        """
        with model.os_errors_as("the authority cannot be repaired"):
            if was_killed or self.ledger.state.open:
                model.sweep(self.folder)
            model.folders(self.folder)
            for operation in tuple(self.ledger.state.open):
                self.ledger.write([self._end(operation)], operation)
            model.restore_copies(self.folder, self.ledger.state.issued.values())
            of = self.ledger.state.server
            whole = of is None or is_sound(self.folder, of)
        if of is not None and not whole:
            self.serve(names_of(of))
        if is_crl_due(self.folder, self.ledger, self.ca):
            self.publish(new_operation())

    def _end(self, operation: str) -> CommitRecord | RolledBack:
        state = self.ledger.state
        withdrawn_names = tuple(name for name, of in state.pending.items() if of == operation)
        whole = state.done[operation].issuperset(state.open[operation].names)
        return CommitRecord() if whole and not withdrawn_names else RolledBack(common_names=withdrawn_names)

    @cached_property
    def _server_key(self) -> Secret:
        return self._secret(model.TLS_CRYPT_V2)

    @cached_property
    def _shared_key(self) -> Secret:
        return self._secret(model.TLS_CRYPT)

    def _secret(self, name: str) -> Secret:
        with model.os_errors_as("a key of the server cannot be read"):
            return Secret((self.folder / name).read_text(encoding="ascii"))


CRL_BACKDATE = timedelta(days=1)
"""A server whose clock is behind ours would refuse everybody with a list that is not yet valid (facts 4)."""


FRESH = timedelta(days=60)
"""A list whose `nextUpdate` is nearer is re-signed in passing: frequent users never see a warning."""


def revoked_serials(state: LedgerState) -> list[pki.RevokedSerial]:
    """Return the serials that must be on the revocation list."""
    ours = (
        pki.RevokedSerial(certificate.serial, certificate.revoked)
        for _, certificate in state.membership().certificates()
        if certificate.standing is identity.CertificateStatus.REVOKED and certificate.revoked is not None
    )
    return [*ours, *(pki.RevokedSerial(serial, at) for serial, at in state.taken.items())]


def sign_crl(
    ca: pki.Ca, lines: Iterable[pki.RevokedSerial], number: int, now: datetime
) -> tuple[bytes, PublicationRecord]:
    """Return a signed list with its record. Raises InvalidCrlError if a server could not accept it now."""
    back = max(now - CRL_BACKDATE, ca.certificate.not_valid_before_utc)
    pem = pki.new_crl(ca, lines, number, back, pki.CRL_DAYS + CRL_BACKDATE.days)
    facts = pki.check_crl(pem, ca.certificate, above=number - 1, now=now)
    current = len(facts.serials)
    return pem, PublicationRecord(number=number, sha256=facts.sha256, next_update=facts.next_update, revoked=current)


def publish_crl(
    folder: Path, ledger_session: LedgerSession, ca: pki.Ca, operation: str, also: pki.CrlFacts | None = None
) -> bytes:
    """Sign, record and store the list of the recorded state; return PEM. `also`: a list that is taken over."""
    path, membership, now = folder / model.CRL, ledger_session.state.membership(), ledger_session.now()
    before = [entry for entry in (_in_place(path, ca.certificate), also) if entry is not None]
    above = max(membership.crl_number, *(crl_facts.number for crl_facts in before), 0)
    lines = {revoked_serial.serial: revoked_serial for revoked_serial in revoked_serials(ledger_session.state)}
    # What is on a list of before stays: a ledger from an older backup lets nobody back in.
    earlier_serials = {
        serial: pki.RevokedSerial(serial, item.this_update) for item in before for serial in sorted(item.serials)
    }
    pem, record = sign_crl(ca, (earlier_serials | lines).values(), above + 1, now)
    ledger_session.write([record], operation)
    with model.os_errors_as("the revocation list cannot be written"):
        pki.publish(path, pem, ca.certificate, above=above, now=now)
    return pem


def is_crl_due(folder: Path, ledger_session: LedgerSession, ca: pki.Ca) -> bool:
    """Return True if the stored list differs from the record, or is getting old."""
    membership, now = ledger_session.state.membership(), ledger_session.now()
    try:
        facts = pki.check_crl((folder / model.CRL).read_bytes(), ca.certificate, above=None, now=now)
    except (OSError, pki.InvalidCrlError):
        return True
    serials = frozenset(revoked_serial.serial for revoked_serial in revoked_serials(ledger_session.state))
    return facts.sha256 != membership.crl_sha256 or not serials <= facts.serials or facts.next_update - now < FRESH


def beyond_record(folder: Path, state: LedgerState, ca: x509.Certificate, pem: bytes) -> str | None:
    """Describe what a server's list contains beyond the record; None: nothing, or it is another CA's list."""
    try:
        there = pki.read_crl(pem, ca)
    except pki.InvalidCrlError:
        return None
    membership, here = state.membership(), _in_place(folder / model.CRL, ca)
    known_serials = {revoked_serial.serial for revoked_serial in revoked_serials(state)} | (
        here.serials if here is not None else frozenset()
    )
    unknown_serials = there.serials - known_serials
    if there.sha256 == membership.crl_sha256 or (there.number < membership.crl_number and not unknown_serials):
        return None
    good = sorted(
        certificate.common_name for _, certificate in membership.certificates() if certificate.serial in unknown_serials
    )
    last = membership.crl_number
    text = msg(f"its revocation list has number {arg(there.number)}, but the last one in the record is {arg(last)}")
    if there.number == last:
        text = msg(
            f"its revocation list has number {arg(there.number)} like the last one in the record, but a different "
            "content"
        )
    more = [msg(f"it revokes {arg(join(', ', good))}")] if good else []
    if strange := len(unknown_serials) - len(good):
        more.append(msg(f"it revokes {arg(strange)}, never issued in the record"))
    return join("; ", [text, *more])


def _in_place(path: Path, ca: x509.Certificate) -> pki.CrlFacts | None:
    """Return our stored list, even if expired; None if there is none."""
    try:
        return pki.read_crl(path.read_bytes(), ca)
    except (OSError, pki.InvalidCrlError):
        return None
