"""The records of the ledger: events in the order in which they became certain; and their descriptions for `audit`.

A record that announces a step (`BeginRecord`, `IssueRecord`, `RevocationRecord`, `PublicationRecord`) is on disk before
anything is handed out or stored; `DeliveryRecord` follows the file that it names. None contains a secret.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime  # noqa: TC003 - pydantic reads the fields' types
from ipaddress import IPv4Address  # noqa: TC003 - as above
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import RosDistribution  # noqa: TC001 - as above
from atlantis_netcfg.vpn import identity  # noqa: TC001 - as above

Command = Literal["issue", "renew", "revoke", "publish", "serve"]
Serial = Annotated[
    int,
    BeforeValidator(lambda value: int(value, 16) if isinstance(value, str) else value),
    PlainSerializer(lambda value: f"{value:x}"),
]
"""Serial number in hex, as printed by openssl: tools that read JSON numbers as fractions would round it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundingRecord:
    """First record of every ledger: the identity of its authority."""

    kind: Literal["founded"] = "founded"
    ca_common_name: str
    ca_sha256: str
    """SHA-256 of the CA's certificate in DER form."""
    ca_not_after: datetime
    sealed_by: Literal["age", "vault"]
    heads: bool = False
    """Whether the lines were signed from the start; older versions signed none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerIssueRecord:
    """The server got this certificate, which replaces the previous one."""

    kind: Literal["server-issued"] = "server-issued"
    common_name: str
    dns: tuple[str, ...]
    addresses: tuple[IPv4Address, ...]
    serial: Serial
    sha256: str
    not_before: datetime
    not_after: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class BeginRecord:
    """A command begins; it is open until `CommitRecord` or `RolledBack` of the same operation."""

    kind: Literal["begun"] = "begun"
    command: Command
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class IssueRecord:
    """A certificate was created, in this process' memory only. Without a `DeliveryRecord` it counts as revoked."""

    kind: Literal["issued"] = "issued"
    name: str
    device_kind: identity.MemberKind
    partner: str | None
    device: str
    address: IPv4Address
    link: identity.MemberLink
    vehicle: str | None
    common_name: str
    serial: Serial
    sha256: str
    not_before: datetime
    not_after: datetime
    wrap: identity.Wrap
    key: identity.KeyType
    request_id: str = ""
    system: identity.ClientSystem | None = None
    distribution: RosDistribution | None = None
    der: str
    """The certificate, base64: its copy in `certs/` can be recreated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeliveryRecord:
    """The member's file is on disk."""

    kind: Literal["delivered"] = "delivered"
    common_name: str
    path: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CommitRecord:
    """The command is complete."""

    kind: Literal["committed"] = "committed"


@dataclass(frozen=True, slots=True, kw_only=True)
class RolledBack:
    """The command did not complete: these certificates were never delivered, and stay revoked."""

    kind: Literal["rolled-back"] = "rolled-back"
    common_names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RevocationRecord:
    """No server may accept this certificate any more."""

    kind: Literal["revoked"] = "revoked"
    common_name: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SightingRecord:
    """The server had a session with this certificate; `last` is by the server's clock."""

    kind: Literal["seen"] = "seen"
    common_name: str
    last: datetime


@dataclass(frozen=True, slots=True, kw_only=True)
class SupersedeRecord:
    """A successor was seen: the server refuses this certificate, and the next list will contain it."""

    kind: Literal["superseded"] = "superseded"
    common_name: str
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlementRecord:
    """The server confirmed that this revoked certificate has no session, and gets none."""

    kind: Literal["settled"] = "settled"
    common_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PublicationRecord:
    """This list was signed, and is about to be stored."""

    kind: Literal["published"] = "published"
    number: int
    sha256: str
    next_update: datetime
    revoked: int
    """Number of revoked certificates on the list."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeoverRecord:
    """Serials on a list signed by a lost copy of the authority, not issued by this one."""

    kind: Literal["taken"] = "taken"
    serials: tuple[Serial, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockTrustRecord:
    """The clock was before the last record, and the user confirmed that it is right."""

    kind: Literal["clock-trusted"] = "clock-trusted"
    before: datetime
    """Time of the last record, which was later than the clock."""


Record = Annotated[
    FoundingRecord
    | ServerIssueRecord
    | BeginRecord
    | IssueRecord
    | DeliveryRecord
    | CommitRecord
    | RolledBack
    | RevocationRecord
    | SightingRecord
    | SupersedeRecord
    | SettlementRecord
    | PublicationRecord
    | TakeoverRecord
    | ClockTrustRecord,
    Field(discriminator="kind"),
]

_COMMANDS = {
    "issue": "onboarding of {} began",
    "renew": "renewal of {} began",
    "revoke": "revocation of {} began",
    "publish": "a new revocation list was requested",
    "serve": "a new server certificate was requested",
}
_MAX_NAMES = 3
"""Maximum names listed; the others are counted."""


def describe(record: Record) -> str:
    """Describe the event in one line."""
    match record:
        case BeginRecord() | CommitRecord() | RolledBack():
            return _command_text(record)
        case IssueRecord() | DeliveryRecord() | RevocationRecord() | TakeoverRecord():
            return _certificate_text(record)
        case SightingRecord() | SupersedeRecord() | SettlementRecord():
            return _server_text(record)
        case _:
            return _authority_text(record)


def _command_text(record: BeginRecord | CommitRecord | RolledBack) -> str:
    match record:
        case BeginRecord():
            return msg(_COMMANDS[record.command].format(arg(_join_names(record.names))))
        case CommitRecord():
            return "command completed"
        case RolledBack(common_names=()):
            return "command not completed; everything that it had handed out is recorded"
        case RolledBack():
            return msg(
                f"command not completed: {arg(_join_names(record.common_names))} was never handed out and is revoked"
            )


def _certificate_text(record: IssueRecord | DeliveryRecord | RevocationRecord | TakeoverRecord) -> str:
    match record:
        case IssueRecord():
            whose = msg(f"partner {arg(record.partner)}" if record.partner else "the pilot")
            until = msg(f"valid until {arg(_day(record.not_after))}, serial {arg(record.serial):x}")
            return msg(
                f"{arg(record.common_name)} issued: {arg(record.device_kind)} of {arg(whose)}, {arg(record.address)}, "
                f"{arg(until)}"
            )
        case DeliveryRecord():
            return msg(f"{arg(record.common_name)} handed out: {arg(record.path)} (SHA-256 {arg(record.sha256)})")
        case RevocationRecord():
            return msg(f"{arg(record.common_name)} revoked: {arg(record.reason)}")
        case TakeoverRecord():
            serials = _join_names(tuple(f"{serial:x}" for serial in record.serials))
            return msg(
                f"taken over from the server's revocation list (issued by a lost copy of the authority): {arg(serials)}"
            )


def _server_text(record: SightingRecord | SupersedeRecord | SettlementRecord) -> str:
    match record:
        case SightingRecord():
            return msg(f"{arg(record.common_name)} was connected, last at {arg(record.last):%Y-%m-%d %H:%M} UTC")
        case SupersedeRecord():
            return msg(f"{arg(record.common_name)} superseded: {arg(record.by)} is in use")
        case SettlementRecord():
            return msg(f"the server confirmed that {arg(record.common_name)} is locked out")


def _authority_text(
    record: FoundingRecord | ServerIssueRecord | PublicationRecord | ClockTrustRecord,
) -> str:
    match record:
        case FoundingRecord():
            return msg(f"authority {arg(record.ca_common_name)} created, valid until {arg(_day(record.ca_not_after))}")
        case ServerIssueRecord():
            names = join(", ", (*record.dns, *map(str, record.addresses)))
            return msg(
                f"server certificate {arg(record.common_name)} issued for {arg(names)}, valid until "
                f"{arg(_day(record.not_after))}"
            )
        case PublicationRecord():
            current = msg(f"{arg(record.revoked)} revoked, valid until {arg(_day(record.next_update))}")
            return msg(f"revocation list {arg(record.number)} signed: {arg(current)}")
        case ClockTrustRecord():
            return msg(
                "the clock was confirmed as right, although the previous record is dated "
                f"{arg(record.before):%Y-%m-%d %H:%M} UTC"
            )


def _join_names(names: tuple[str, ...]) -> str:
    text = join(", ", names[:_MAX_NAMES])
    return text if len(names) <= _MAX_NAMES else msg(f"{arg(text)} and {arg(len(names) - _MAX_NAMES)} more")


def _day(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d}"
