"""Certificates are made, recorded, handed out, recorded again: in that order, and so many at a time."""

from __future__ import annotations

import base64
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cryptography.hazmat.primitives.serialization import Encoding

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import _files as files
from atlantis_netcfg.vpn.authority._book import new_operation
from atlantis_netcfg.vpn.authority._errors import os_errors_as
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, Identity
from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.authority._desk import SigningSession
    from atlantis_netcfg.vpn.authority._plan import Planned
    from atlantis_netcfg.vpn.authority._types import Delivered

__all__ = ["hand_out"]

BATCH = 100
"""Two waits for the disk for so many; and no more than these are made anew when a command is killed."""
REPLACED = "replaced before it was seen in use"


@dataclass(frozen=True, slots=True)
class _Made:
    """A certificate that nobody but this process has."""

    planned: Planned
    record: records.Issued
    key: Secret


def hand_out(
    prompt: SigningSession,
    command: records.Command,
    planned: Sequence[Planned],
    deliver: Callable[[Identity], Delivered],
) -> None:
    """Make these certificates and hand them out; each is on disk in the ledger before `deliver` sees it.

    If anything fails, what was handed out stands, the rest is withdrawn, and the error goes on.
    """
    operation = new_operation()
    try:
        prompt.book.write([records.Begun(command=command, names=_names(planned))], operation)
        for start in range(0, len(planned), BATCH):
            _batch(prompt, operation, planned[start : start + BATCH], deliver)
        # Also without a revocation: by the number of its list a server knows a record that is older than this one.
        prompt.publish(operation)
        prompt.book.write([records.Committed()], operation)
    except Exception:
        # Best effort, while the disk is as it is: the next command looks again.
        if prompt.book.usable:
            with suppress(NetcfgError, OSError):
                prompt.recover(left=False)
        raise


def _names(planned: Sequence[Planned]) -> tuple[str, ...]:
    return tuple(item.member.name for item in planned)


def _batch(
    prompt: SigningSession, operation: str, planned: Sequence[Planned], deliver: Callable[[Identity], Delivered]
) -> None:
    made = [_made(prompt, one) for one in planned]
    prompt.book.write([entry.record for entry in made], operation)
    done: list[records.Record] = []
    try:
        with os_errors_as("the certificates cannot be written"):
            files.restore_copies(prompt.folder, [item.record for item in made])
        for one in made:
            with os_errors_as(f"what `{one.planned.member.name}` gets cannot be written"):
                delivered = deliver(_identity(prompt, one))
            done.extend(_handed_out(one.planned, delivered))
    finally:
        if done:
            prompt.book.write(done, operation)


def _handed_out(planned: Planned, delivered: Delivered) -> Iterator[records.Record]:
    yield records.Delivered(common_name=planned.common_name, path=delivered.path, sha256=delivered.sha256)
    for old in planned.replaces:
        yield records.Revoked(common_name=old, reason=REPLACED)


def _made(prompt: SigningSession, planned: Planned) -> _Made:
    key = pki.new_key(planned.key)
    certificate = pki.new_client(
        prompt.ca, key.public_key(), planned.common_name, pki.new_serial(), planned.days, prompt.book.now()
    )
    member = planned.member
    record = records.Issued(
        name=member.name,
        device_kind=member.kind,
        partner=member.partner,
        device=member.device,
        address=member.address,
        link=member.link,
        vehicle=member.vehicle,
        common_name=planned.common_name,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
        wrap=planned.wrap,
        key=planned.key,
        request_id=planned.request_id,
        der=base64.b64encode(certificate.public_bytes(Encoding.DER)).decode("ascii"),
    )
    return _Made(planned, record, pki.key_pem(key))


def _identity(prompt: SigningSession, made: _Made) -> Identity:
    record = made.record
    certificate = Certificate(
        common_name=record.common_name,
        serial=record.serial,
        sha256=record.sha256,
        not_before=record.not_before,
        not_after=record.not_after,
        wrap=record.wrap,
        key=record.key,
        standing=CertificateStatus.ISSUED,
    )
    before = made.planned.member
    return Identity(
        member=replace(before, certificates=(*before.certificates, certificate)),
        certificate=certificate,
        ca=prompt.ca_pem,
        cert=files.copy_of(record).decode("ascii"),
        key=made.key,
        wrap_key=prompt.wrap_key(record.wrap, record.common_name),
    )
