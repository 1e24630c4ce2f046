"""The revocation list: made from the record, recorded, then put in place."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.files import CRL
from atlantis_netcfg.vpn.authority.model import os_errors_as
from atlantis_netcfg.vpn.identity import CertificateStatus
from atlantis_netcfg.vpn.ledger.records import Published

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import datetime
    from pathlib import Path

    from cryptography import x509

    from atlantis_netcfg.vpn.authority.ledger_session import LedgerSession
    from atlantis_netcfg.vpn.ledger import LedgerState

BACKDATED = timedelta(days=1)
"""A server whose clock is behind ours would refuse everybody with a list that is not valid yet (facts 4)."""
FRESH = timedelta(days=60)
"""A list with less than this until its `nextUpdate` is signed anew in passing: who works often never sees an alarm."""


def revoked_serials(state: LedgerState) -> list[pki.RevokedSerial]:
    """What must be on the list."""
    ours = (
        pki.RevokedSerial(certificate.serial, certificate.revoked)
        for _, certificate in state.membership().certificates()
        if certificate.standing is CertificateStatus.REVOKED and certificate.revoked is not None
    )
    return [*ours, *(pki.RevokedSerial(serial, at) for serial, at in state.taken.items())]


def sign_crl(ca: pki.Ca, lines: Iterable[pki.RevokedSerial], number: int, now: datetime) -> tuple[bytes, Published]:
    """A list with its record. Raises CrlRefused: never one that a server could not have now."""
    back = max(now - BACKDATED, ca.certificate.not_valid_before_utc)
    pem = pki.new_crl(ca, lines, number, back, pki.CRL_DAYS + BACKDATED.days)
    facts = pki.check_crl(pem, ca.certificate, above=number - 1, now=now)
    current = len(facts.serials)
    return pem, Published(number=number, sha256=facts.sha256, next_update=facts.next_update, revoked=current)


def publish_crl(
    folder: Path, ledger_session: LedgerSession, ca: pki.Ca, operation: str, also: pki.CrlFacts | None = None
) -> bytes:
    """Sign the list of the record's state, record it, and put it in place; PEM. `also`: a list that is taken over."""
    path, membership, now = folder / CRL, ledger_session.state.membership(), ledger_session.now()
    before = [entry for entry in (_in_place(path, ca.certificate), also) if entry is not None]
    above = max(membership.crl_number, *(crl_facts.number for crl_facts in before), 0)
    lines = {revoked_serial.serial: revoked_serial for revoked_serial in revoked_serials(ledger_session.state)}
    # What is on a list of before stays: a ledger from an older backup lets nobody back in.
    kept = {serial: pki.RevokedSerial(serial, item.this_update) for item in before for serial in sorted(item.serials)}
    pem, record = sign_crl(ca, (kept | lines).values(), above + 1, now)
    ledger_session.write([record], operation)
    with os_errors_as("the revocation list cannot be written"):
        pki.publish(path, pem, ca.certificate, above=above, now=now)
    return pem


def is_crl_due(folder: Path, ledger_session: LedgerSession, ca: pki.Ca) -> bool:
    """Whether the list in place is not the one that the record asks for, or is getting old."""
    membership, now = ledger_session.state.membership(), ledger_session.now()
    try:
        facts = pki.check_crl((folder / CRL).read_bytes(), ca.certificate, above=None, now=now)
    except (OSError, pki.CrlRefused):
        return True
    serials = frozenset(revoked_serial.serial for revoked_serial in revoked_serials(ledger_session.state))
    return facts.sha256 != membership.crl_sha256 or not serials <= facts.serials or facts.next_update - now < FRESH


def beyond_record(folder: Path, state: LedgerState, ca: x509.Certificate, pem: bytes) -> str | None:
    """What a list that a server has says beyond the record, in words; None: nothing, or it is not of this CA."""
    try:
        there = pki.read_crl(pem, ca)
    except pki.CrlRefused:
        return None
    membership, here = state.membership(), _in_place(folder / CRL, ca)
    known = {revoked_serial.serial for revoked_serial in revoked_serials(state)} | (
        here.serials if here is not None else frozenset()
    )
    lost = there.serials - known
    if there.sha256 == membership.crl_sha256 or (there.number < membership.crl_number and not lost):
        return None
    good = sorted(certificate.common_name for _, certificate in membership.certificates() if certificate.serial in lost)
    last = membership.crl_number
    text = f"its list of revoked certificates is number {there.number}, and the record's last one is {last}"
    if there.number == last:
        text = f"its list of revoked certificates is number {there.number} as the record's last one, and another one"
    more = [f"it revokes {', '.join(good)}"] if good else []
    if strange := len(lost) - len(good):
        more.append(f"it revokes {strange} that the record has never issued")
    return "; ".join([text, *more])


def _in_place(path: Path, ca: x509.Certificate) -> pki.CrlFacts | None:
    """The list of ours that is there, also an expired one."""
    try:
        return pki.read_crl(path.read_bytes(), ca)
    except (OSError, pki.CrlRefused):
        return None
