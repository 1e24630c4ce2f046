"""The records in plain words, for `audit`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from datetime import datetime

__all__ = ["describe"]

_COMMANDS = {
    "issue": "onboarding of {} began",
    "renew": "renewal of {} began",
    "revoke": "revocation of {} began",
    "publish": "a new revocation list was asked for",
    "serve": "a new certificate of the server was asked for",
}
_NAMED = 3
"""So many names are told, the others are counted."""


def describe(record: records.Record) -> str:
    """What happened, one line."""
    match record:
        case records.Begun() | records.Committed() | records.RolledBack():
            return _of_command(record)
        case records.Issued() | records.Delivered() | records.Revoked() | records.Taken():
            return _of_certificate(record)
        case records.Seen() | records.Superseded() | records.Settled():
            return _of_server(record)
        case _:
            return _of_authority(record)


def _of_command(record: records.Begun | records.Committed | records.RolledBack) -> str:
    match record:
        case records.Begun():
            return _COMMANDS[record.command].format(_listed(record.names))
        case records.Committed():
            return "the command is complete"
        case records.RolledBack(common_names=()):
            return "the command was not completed; nothing of it had left that is not recorded"
        case records.RolledBack():
            return f"the command was not completed: {_listed(record.common_names)} was never handed out, and is revoked"


def _of_certificate(record: records.Issued | records.Delivered | records.Revoked | records.Taken) -> str:
    match record:
        case records.Issued():
            whose = f"partner {record.partner}" if record.partner else "the pilot"
            until = f"good until {_day(record.not_after)}, serial {record.serial:x}"
            return f"{record.common_name} issued: {record.device_kind} of {whose}, {record.address}, {until}"
        case records.Delivered():
            return f"{record.common_name} handed out: {record.path} (SHA-256 {record.sha256})"
        case records.Revoked():
            return f"{record.common_name} revoked: {record.reason}"
        case records.Taken():
            serials = _listed(tuple(f"{serial:x}" for serial in record.serials))
            return f"taken over from the server's list, issued by a copy of the authority that is lost: {serials}"


def _of_server(record: records.Seen | records.Superseded | records.Settled) -> str:
    match record:
        case records.Seen():
            return f"{record.common_name} was connected, last at {record.last:%Y-%m-%d %H:%M} UTC"
        case records.Superseded():
            return f"{record.common_name} superseded: {record.by} was seen in use"
        case records.Settled():
            return f"the server confirmed that {record.common_name} is out"


def _of_authority(
    record: records.Founded | records.ServerIssued | records.Published | records.Resealed | records.ClockTrusted,
) -> str:
    match record:
        case records.Founded():
            return f"authority {record.ca_common_name} founded, good until {_day(record.ca_not_after)}"
        case records.ServerIssued():
            names = ", ".join((*record.dns, *map(str, record.addresses)))
            return f"server certificate {record.common_name} issued for {names}, good until {_day(record.not_after)}"
        case records.Published():
            current = f"{record.revoked} revoked, good until {_day(record.next_update)}"
            return f"revocation list {record.number} signed: {current}"
        case records.Resealed():
            return f"the CA key was put under another passphrase ({record.sealed_by})"
        case records.ClockTrusted():
            return (
                f"the clock was said to be right, although the record before is of {record.before:%Y-%m-%d %H:%M} UTC"
            )


def _listed(names: tuple[str, ...]) -> str:
    text = ", ".join(names[:_NAMED])
    return text if len(names) <= _NAMED else f"{text} and {len(names) - _NAMED} more"


def _day(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d}"
