"""What the record makes of sessions that the server has, or had."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.authority._types import Sighting
from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.vpn.identity import Certificate, Member
    from atlantis_netcfg.vpn.ledger import Fold

__all__ = ["sighting"]

_DAY = timedelta(days=1)


def sighting(fold: Fold, sightings: Mapping[str, datetime]) -> tuple[list[records.Record], Sighting]:
    """What is new, as records, and what it means."""
    members = {fold.issued[name].name: None for name in sightings if name in fold.issued}
    new: list[records.Record] = []
    withdrawn: list[str] = []
    for name in members:
        member = fold.member(name)
        new.extend(_of_member(member, sightings))
        withdrawn.extend(
            one.common_name for one in member.certificates if _after_its_end(one, sightings.get(one.common_name))
        )
    superseded = tuple(one.common_name for one in new if isinstance(one, records.Superseded))
    strangers = tuple(name for name in sightings if name not in fold.issued)
    return new, Sighting(superseded, strangers, tuple(withdrawn))


def _of_member(member: Member, sightings: Mapping[str, datetime]) -> Iterator[records.Record]:
    good = member.good
    for one in good:
        last = sightings.get(one.common_name)
        if last is not None and (one.seen is None or last - one.seen >= _DAY):
            yield records.Seen(common_name=one.common_name, last=last)
    in_use = [number for number, one in enumerate(good) if one.common_name in sightings or one.seen is not None]
    for old in good[: max(in_use, default=0)]:
        yield records.Superseded(common_name=old.common_name, by=good[max(in_use)].common_name)


def _after_its_end(certificate: Certificate, last: datetime | None) -> bool:
    return last is not None and certificate.revoked is not None and last > certificate.revoked
