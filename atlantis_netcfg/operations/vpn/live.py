"""Synchronisation of the running VPN server with the record, and its observation, without ending sessions.

The files that it must have are computed each time (`live_files`) and compared there: this computer does not remember
what was sent to a server. A revoked member counts as disconnected once the server confirms it, and as queued until
then.
"""

from __future__ import annotations

import hashlib
import time
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.operations.computers.remote_session import ServerLink, ServerRefusal, StaleRecord
from atlantis_netcfg.operations.vpn.server_state import (
    PLACE,
    Crl,
    ServerState,
    VpnSession,
    drift,
    observe,
    read_answer,
    sessions_of,
)
from atlantis_netcfg.vpn import server

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from atlantis_netcfg.computers.parts import File
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.model import SessionObservation
    from atlantis_netcfg.vpn.identity import MembershipList


__all__ = [
    "Crl",
    "PushResult",
    "RevocationEvidence",
    "ServerState",
    "StaleRecord",
    "VpnSession",
    "check_record",
    "desired_files",
    "drift",
    "finish_revocations",
    "note_seen",
    "observe",
    "push",
    "revoke_live",
    "sessions",
    "verify",
]


_TRIES: Final = 3


@dataclass(frozen=True, slots=True)
class PushResult:
    """The changes that a push made on the server."""

    changes: tuple[str, ...]
    """Changes in the wording of a role's run."""
    ended_sessions: tuple[VpnSession, ...] = ()
    """Ended sessions of members who are no longer admitted."""
    notes: tuple[str, ...] = ()
    """Actions that were not carried out."""


@dataclass(frozen=True, slots=True)
class RevocationEvidence:
    """The server's confirmation about members that must be disconnected."""

    common_names: tuple[str, ...]
    addresses: tuple[str, ...]
    """Addresses that no member has any more."""
    files: Mapping[str, str]
    """SHA-256 of the list and the ruleset that must be in place."""
    out: bool
    """Whether none of the members can connect or pass traffic; read back on the server."""
    dead: bool
    """Whether none of the members has a session, as the server reports."""
    left: tuple[str, ...]
    """Remaining problems."""
    notes: tuple[str, ...]
    """What could not be done or read."""
    steps: tuple[tuple[str, float], ...] = ()
    """Completed steps, each with its time in milliseconds after the server received the request."""
    ended: tuple[VpnSession, ...] = ()
    seconds: float = 0.0
    """Seconds from request to response, at this end of the link."""
    looks: int = 1
    replies: tuple[tuple[str, ...], ...] = field(default=())
    """The server's responses for each session in `ended`."""

    @property
    def is_confirmed(self) -> bool:
        """Whether the server has confirmed the disconnection."""
        return self.out and self.dead

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        values = {key: value for key, value in asdict(self).items() if key not in ("ended", "files", "notes")}
        return {
            **values,
            "told": self.notes,
            "confirmed": self.is_confirmed,
            "ended": [session.as_json() for session in self.ended],
        }


def desired_files(
    inventory: Inventory, authority: Authority, membership: MembershipList | None = None
) -> tuple[File, ...]:
    """Return the live files that the server must have, computed from the record."""
    ca = (authority.folder / "ca.crt").read_text(encoding="ascii")
    return server.live_files(
        inventory, authority.membership() if membership is None else membership, authority.crl(), ca=ca
    )


def check_record(authority: Authority, state: ServerState) -> None:
    """Raise RecordOlder if the server's revocation list has entries that the record does not."""
    if state.crl is not None and state.crl.is_signed and (why := authority.beyond(state.crl.pem.encode())) is not None:
        raise StaleRecord(why)


def push(inventory: Inventory, authority: Authority, link: ServerLink) -> PushResult:
    """Send the live files to the server and load its firewall, without ending other sessions.

    Files that it has already are not sent. Raises ServerAway, AnswerLost, ServerRefusal.
    """
    files = desired_files(inventory, authority)
    lacks: Collection[str] = ()
    for _ in range(_TRIES):
        values = link.ask(
            "push", place=dict(PLACE), files=[_build_file_row(file, lacks) for file in files], only=[server.CCD]
        )
        with read_answer("push"):
            missing = tuple(map(str, values["lacks"]))
            if not missing:
                ended_sessions = sessions_of({"sessions": values["ended"]})
                return PushResult(tuple(map(str, values["changes"])), ended_sessions, tuple(map(str, values["told"])))
        lacks = [*lacks, *missing]
    raise ServerRefusal(
        f"files of the server changed during this run: {arg(join(', ', missing))}",
        hint="somebody else is working there; run the same command again",
    )


def revoke_live(
    inventory: Inventory, authority: Authority, link: ServerLink, common_names: Sequence[str]
) -> RevocationEvidence:
    """Disconnect members whose certificates are revoked in the record, in one round trip; the queue is kept.

    Raises ServerAway, AnswerLost, ServerRefusal.
    """
    membership = authority.membership()
    files = [
        file for file in desired_files(inventory, authority, membership) if file.path in (PLACE["crl"], server.FIREWALL)
    ]
    names, addresses = tuple(common_names), _addresses(membership, common_names)
    began = time.monotonic()
    values = link.ask(
        "revoke",
        place=dict(PLACE),
        files=[_row(file) | {"content": file.content} for file in files],
        common_names=list(names),
        addresses=list(addresses),
    )
    seconds = time.monotonic() - began
    hashes = {file.path: _sha256(file) for file in files}
    with read_answer("revoke"):
        return RevocationEvidence(
            names,
            addresses,
            hashes,
            *_words(values),
            steps=tuple((str(name), float(at)) for name, at in values["steps"]),
            ended=sessions_of({"sessions": values["ended"]}),
            seconds=seconds,
            replies=tuple(tuple(map(str, item["replies"])) for item in values["ended"]),
        )


def verify(link: ServerLink, evidence: RevocationEvidence) -> RevocationEvidence:
    """Check the disconnection again, after a second and after `hand-window`: a handshake may use the old list."""
    values = link.ask(
        "verify",
        place=dict(PLACE),
        common_names=list(evidence.common_names),
        addresses=list(evidence.addresses),
        files=dict(evidence.files),
    )
    with read_answer("verify"):
        out, dead, problems, notes = _words(values)
    return replace(evidence, out=out, dead=dead, left=problems, notes=notes, looks=evidence.looks + 1)


def _words(values: Mapping[str, Any]) -> tuple[bool, bool, tuple[str, ...], tuple[str, ...]]:
    """Return whether members are out and dead, what remains and what was not done; only `true` counts as yes."""
    return (
        values["out"] is True,
        values["dead"] is True,
        tuple(map(str, values["left"])),
        tuple(map(str, values["told"])),
    )


def finish_revocations(
    inventory: Inventory, authority: Authority, link: ServerLink, who: str = ""
) -> RevocationEvidence | None:
    """Disconnect queued members and dequeue those that the server confirms; None if the queue is empty."""
    queue = authority.membership().queued_names
    if not queue:
        return None
    evidence = revoke_live(inventory, authority, link, queue)
    if evidence.is_confirmed:
        authority.confirm_revocations(queue, who)
    return evidence


def sessions(link: ServerLink) -> tuple[VpnSession, ...]:
    """Return the current sessions; if the server cannot be queried, those of its last status file."""
    values = link.ask("sessions", place=dict(PLACE))
    with read_answer("sessions"):
        return sessions_of(values)


def note_seen(
    inventory: Inventory, authority: Authority, link: ServerLink, state: ServerState, who: str = ""
) -> tuple[SessionObservation, PushResult | None]:
    """Record observed sessions; if a successor was seen, its predecessor is no longer admitted: that is pushed."""
    now = datetime.now(UTC)
    time_by_name = {name: min(at, now) for name, at in state.last_sessions.items()}
    for session in state.sessions:
        if session.is_up:
            time_by_name[session.common_name] = max(
                time_by_name.get(session.common_name, session.since), min(state.at, now)
            )
    sighting = authority.record_sessions(time_by_name, who)
    return sighting, push(inventory, authority, link) if sighting.superseded_names else None


def _addresses(membership: MembershipList, common_names: Collection[str]) -> tuple[str, ...]:
    """Return the addresses of members without a valid certificate: those of others are still in use."""
    return tuple(
        str(member.address)
        for member in membership.members.values()
        if not member.good and any(certificate.common_name in common_names for certificate in member.certificates)
    )


def _build_file_row(file: File, lacks: Collection[str]) -> dict[str, Any]:
    return _row(file) | ({"content": file.content} if file.path in lacks else {"sha256": _sha256(file)})


def _row(file: File) -> dict[str, Any]:
    row = asdict(file)
    row.pop("content")
    return row


def _sha256(file: File) -> str:
    return hashlib.sha256(file.content.encode()).hexdigest()
