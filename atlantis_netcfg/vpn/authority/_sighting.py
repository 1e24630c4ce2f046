"""What the record makes of sessions that the server has, or had."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.authority._types import SessionObservation
from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.vpn.identity import Certificate, Member
    from atlantis_netcfg.vpn.ledger import LedgerState

__all__ = ["observe_sessions"]

_DAY = timedelta(days=1)


def observe_sessions(
    fold: LedgerState, sightings: Mapping[str, datetime]
) -> tuple[list[records.Record], SessionObservation]:
    """What is new, as records, and what it means."""
    members = {fold.issued[name].name: None for name in sightings if name in fold.issued}
    new: list[records.Record] = []
    withdrawn: list[str] = []
    for name in members:
        member = fold.member(name)
        new.extend(_of_member(member, sightings))
        withdrawn.extend(
            certificate.common_name
            for certificate in member.certificates
            if _after_its_end(certificate, sightings.get(certificate.common_name))
        )
    superseded = tuple(item.common_name for item in new if isinstance(item, records.Superseded))
    strangers = tuple(name for name in sightings if name not in fold.issued)
    return new, SessionObservation(superseded, strangers, tuple(withdrawn))


def _of_member(member: Member, sightings: Mapping[str, datetime]) -> Iterator[records.Record]:
    good = member.good
    for item in good:
        last = sightings.get(item.common_name)
        if last is not None and (item.seen is None or last - item.seen >= _DAY):
            yield records.Seen(common_name=item.common_name, last=last)
    in_use = [
        number
        for number, certificate in enumerate(good)
        if certificate.common_name in sightings or certificate.seen is not None
    ]
    for old in good[: max(in_use, default=0)]:
        yield records.Superseded(common_name=old.common_name, by=good[max(in_use)].common_name)


def _after_its_end(certificate: Certificate, last: datetime | None) -> bool:
    return last is not None and certificate.revoked is not None and last > certificate.revoked
