"""Problems of the folder as text, for `status` and `audit`; each check runs independently of the others."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.vpn import ledger, pki
from atlantis_netcfg.vpn.authority import ledger_session, model
from atlantis_netcfg.vpn.authority.model import is_held, os_errors_as
from atlantis_netcfg.vpn.ledger import LedgerEntry, LedgerState, Reading, records

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from cryptography import x509


SOON = timedelta(days=30)
"""Warning time before a list or a certificate expires."""
CA_SOON = timedelta(days=365)
"""Warning time before the CA expires: a new one means new files for everybody."""
_PRIVATE = (*model.SEALED_KEY_FILES.values(), ledger.FILE, model.SERVER_KEY, model.TLS_CRYPT, model.TLS_CRYPT_V2)
_WITHOUT_KEY = (records.SightingRecord, records.SupersedeRecord, records.SettlementRecord, records.DeliveryRecord)
"""Records that are written while the CA key is sealed."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Compared ledger lines, and disagreements."""

    lines: int
    signed_lines: int
    """Number of first lines that are unchanged since signing; the others are chained to them."""
    at: datetime | None
    """Time of signing; None: no evidence of a signature."""
    number: int
    """Number of the last recorded revocation list."""
    problems: tuple[str, ...]


def problems(folder: Path, now: datetime) -> Iterator[str]:
    """Yield the problems that the user has to look at."""
    try:
        reading, state, ca = _load_authority(folder)
    except (NetcfgError, OSError, ValueError) as error:
        yield msg(f"the authority in {arg(folder)} cannot be read: {arg(error)}")
        return
    if reading.damage is not None:
        yield msg(f"{arg(reading.damage)}; nothing is signed until this is repaired")
    yield from _disagreements(folder, reading, state, ca, _head(folder, reading, state, ca))
    yield from _check_expiry(folder, state, ca, now)
    yield from _check_member_expiry(state, now)
    yield from _check_file_modes(folder)


def agreement(folder: Path) -> Agreement:
    """Compare record, signature, certificates and list. Raises CorruptLedgerError, AuthorityError."""
    with os_errors_as("the authority cannot be read"):
        reading, state, ca = _load_authority(folder)
    reading.sound()
    head = _head(folder, reading, state, ca)
    signed_lines, at = (head.line, head.at) if isinstance(head, ledger_session.Head) and head.line else (0, None)
    problem_list = tuple(_disagreements(folder, reading, state, ca, head))
    return Agreement(len(reading.entries), signed_lines, at, state.membership().crl_number, problem_list)


def _load_authority(folder: Path) -> tuple[Reading, LedgerState, x509.Certificate]:
    reading = ledger.read(folder / ledger.FILE)
    return reading, ledger.LedgerState(reading.entries), pki.load_cert((folder / model.CA).read_text(encoding="ascii"))


def _is_of_ledger(state: LedgerState, ca: x509.Certificate) -> bool:
    return state.founded is not None and state.founded.ca_sha256 == pki.sha256(ca)


def _head(
    folder: Path, reading: Reading, state: LedgerState, ca: x509.Certificate
) -> ledger_session.Head | NetcfgError | None:
    """Return the last signed head, or what is wrong with it; None if the ledger is damaged or of another CA."""
    if reading.damage is not None or not _is_of_ledger(state, ca):
        return None
    try:
        head = ledger_session.read_head(folder, ca, state)
        head.hold(reading.digests)
    except NetcfgError as error:
        return error
    return head


def _disagreements(
    folder: Path,
    reading: Reading,
    state: LedgerState,
    ca: x509.Certificate,
    head: ledger_session.Head | NetcfgError | None,
) -> Iterator[str]:
    """Yield contradictions between the ledger and its head, the certificates and the list, in both directions."""
    if not _is_of_ledger(state, ca):
        yield msg(f"{arg(model.CA)} is not the certificate authority of the ledger")
        return
    if isinstance(head, NetcfgError):
        yield str(head)
    elif head is not None and head.line == 0:
        yield ledger_session.NONE_SIGNED
    elif head is not None:
        yield from _check_unsigned_lines(folder, reading, state, head)
    yield from _check_unfinished(folder, state)
    yield from _check_times(reading.entries)
    yield from _check_server(folder, state)
    yield from _check_certificates(state, ca)
    yield from _check_copies(folder, state)
    yield from _check_crl(folder, state, ca)


def _check_unsigned_lines(
    folder: Path, reading: Reading, state: LedgerState, head: ledger_session.Head
) -> Iterator[str]:
    """Yield lines after the head that only a command with the CA key can write."""
    # A command that runs, or was killed, has lines of its own there.
    if state.open or is_held(folder):
        return
    for entry in reading.entries[head.line :]:
        if not isinstance(entry.record, _WITHOUT_KEY):
            yield msg(
                f"line {arg(entry.number)} of the ledger must be signed by the CA key but is not: a command was killed "
                "at its end, or something else wrote the line"
            )


def _check_certificates(state: LedgerState, ca: x509.Certificate) -> Iterator[str]:
    for item in state.issued.values():
        try:
            certificate = pki.load_cert(model.copy_of(item).decode("ascii"))
        except NetcfgError:
            yield msg(f"the ledger's entry for {arg(item.common_name)} is not a certificate")
            continue
        reply = (item.serial, item.sha256, item.not_before, item.not_after, f"CN={item.common_name}")
        dates = (certificate.not_valid_before_utc, certificate.not_valid_after_utc)
        has = (certificate.serial_number, pki.sha256(certificate), *dates, certificate.subject.rfc4514_string())
        if reply != has or not pki.issued_by(certificate, ca):
            yield msg(
                f"the certificate of {arg(item.common_name)} in the ledger was not signed like this by this authority"
            )


def _check_times(entries: Sequence[LedgerEntry]) -> Iterator[str]:
    for before, after in pairwise(entries):
        if after.at < before.at and not isinstance(after.record, records.ClockTrustRecord):
            yield msg(f"line {arg(after.number)} of the ledger is older than the line before it")


def _check_unfinished(folder: Path, state: LedgerState) -> Iterator[str]:
    if state.open and not is_held(folder):
        commands = join(
            ", ", sorted(f"{record.command} {' '.join(record.names[:3])}".strip() for record in state.open.values())
        )
        yield msg(f"a command was not completed ({arg(commands)}): the next one that signs repairs it")


def _check_expiry(folder: Path, state: LedgerState, ca: x509.Certificate, now: datetime) -> Iterator[str]:
    if ca.not_valid_after_utc - now < CA_SOON:
        yield msg(
            f"the certificate authority expires on {arg(ca.not_valid_after_utc):%Y-%m-%d}: create a new one in time"
        )
    if state.server is not None and state.server.not_after - now < SOON:
        yield msg(f"the server's certificate expires on {arg(state.server.not_after):%Y-%m-%d}")
    try:
        pem = (folder / model.CRL).read_bytes()
        following = pki.read_crl(pem, ca).next_update
    except (OSError, pki.InvalidCrlError):
        return  # which is told as what does not agree
    try:
        pki.check_crl(pem, ca, above=None, now=now)
    except pki.InvalidCrlError as error:
        yield msg(f"{arg(model.CRL)} would lock everybody out, or admit revoked members: {arg(error)}")
        return
    if following - now < SOON:
        yield msg(
            f"{arg(model.CRL)} expires on {arg(following):%Y-%m-%d}; then nobody can connect: provision vpn sync --sign"
        )


def _check_server(folder: Path, state: LedgerState) -> Iterator[str]:
    if state.server is None:
        return
    try:
        certificate = pki.load_cert((folder / model.SERVER_CERT).read_text(encoding="ascii"))
    except (pki.CorruptKeyError, OSError, ValueError) as error:
        yield msg(f"{arg(model.SERVER_CERT)} cannot be read: {arg(error)}")
        return
    if pki.sha256(certificate) != state.server.sha256:
        yield msg(f"{arg(model.SERVER_CERT)} is not the certificate that was recorded")


def _check_copies(folder: Path, state: LedgerState) -> Iterator[str]:
    recorded_copies = {f"{name}.pem": model.copy_of(item) for name, item in state.issued.items()}
    there = {path.name: path for path in sorted((folder / model.CERTS).glob("[!.]*"))}
    for name, path in there.items():
        if name not in recorded_copies:
            yield msg(
                f"{arg(model.CERTS)}/{arg(name)} is not in the record: it was not issued here, or the ledger is an old "
                "copy"
            )
        elif path.read_bytes() != recorded_copies[name]:
            yield msg(f"{arg(model.CERTS)}/{arg(name)} is not the certificate that was recorded")
    for name in recorded_copies.keys() - there.keys():
        yield msg(f"{arg(model.CERTS)}/{arg(name)} is missing; the next command that signs writes it again")


def _check_crl(folder: Path, state: LedgerState, ca: x509.Certificate) -> Iterator[str]:
    try:
        facts = pki.read_crl((folder / model.CRL).read_bytes(), ca)
    except OSError as error:
        yield msg(f"{arg(model.CRL)} cannot be read: {arg(error.strerror)}")
        return
    except pki.InvalidCrlError as error:
        yield msg(f"{arg(model.CRL)} would lock everybody out, or admit revoked members: {arg(error)}")
        return
    membership = state.membership()
    if facts.sha256 != membership.crl_sha256:
        yield msg(
            f"{arg(model.CRL)} (number {arg(facts.number)}) is not the revocation list that was recorded last (number "
            f"{arg(membership.crl_number)})"
        )
    serials = {revoked_serial.serial for revoked_serial in ledger_session.revoked_serials(state)}
    for serial in sorted(serials - facts.serials):
        yield msg(f"{arg(model.CRL)} lacks serial {arg(serial):x}, which is revoked: provision vpn sync --sign")
    for more in sorted(facts.serials - serials):
        yield msg(
            f"{arg(model.CRL)} contains serial {arg(more):x}, which is not revoked in the record: the ledger is an old "
            "copy"
        )


def _check_member_expiry(state: LedgerState, now: datetime) -> Iterator[str]:
    for member in state.membership().members.values():
        if member.good and (last := member.good[-1]).not_after - now < SOON:
            ends = "ended" if last.not_after <= now else "ends"
            yield msg(
                f"{arg(last.common_name)} {arg(ends)} on {arg(last.not_after):%Y-%m-%d}: provision vpn renew "
                f"name={arg(member.name)}"
            )


def _check_file_modes(folder: Path) -> Iterator[str]:
    for path in (folder, *(folder / name for name in _PRIVATE)):
        if path.exists() and path.stat().st_mode & 0o077:
            yield msg(f"{arg(path)} can be read by others: chmod go= {arg(path)}")
