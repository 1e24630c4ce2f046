"""`provision vpn renew`: give members a new certificate, while the one in use goes on working."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, CLOCK, INVENTORY, NO_PUSH

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.identity import Member, MembershipList

COMMAND = Command(
    "vpn renew",
    "give members a new certificate; the old one works until the server has seen the new one",
    words=(
        Word("name", "the member", example="iqua-sparus2"),
        Word("all", "every member whose certificate ends within this time", example="30d"),
        Word("days", "how long the new one is good; 397 if left out", example="90"),
        Word("wrap", "tls-crypt-v2 or tls-crypt; as before if left out"),
        Word("key", "ec or rsa; as before if left out"),
        Word("link", "what carries its tunnel at worst; as before if left out"),
        Word("recipient", "seal the file to this age key, or to the one in this file, not with a passphrase"),
        Word("contact", "whom its owner calls, for the page of instructions", example="'Ana, +351 210 000 000'"),
        Word("to", "also put the file into this folder", example="/media/usb"),
        CLOCK,
        AUTHORITY,
        INVENTORY,
    ),
    flags=(NO_PUSH, PASSPHRASE_FD, JSON),
    details="A successor that was handed out before and never used is revoked: one is under way at a time.",
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Choose the members, issue, hand out, tell the server."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import passphrase_prompt
    from atlantis_netcfg.operations.vpn.members import Onboarding, refuse_example_authority
    from atlantis_netcfg.operations.vpn.requests import change_of, recipient_of

    declaration = _vpn.declared(arguments)
    change = change_of(**{key: arguments.optional(key) for key in ("days", "wrap", "key", "link")})
    typed = arguments.optional("recipient")
    recipient = recipient_of(typed) if typed is not None else None
    refuse_example_authority(declaration, named=arguments.optional("authority") is not None)
    authority = _vpn.opened(arguments)
    members = _chosen(arguments, authority.membership())
    outlet = _members.outlet(arguments, {} if recipient is None else {member.name: recipient for member in members})
    server = _vpn.server(arguments, declaration)
    onboarding = Onboarding(declaration, _vpn.operator(arguments, authority), outlet)
    passphrase = passphrase_prompt(arguments)
    _members.hold(arguments, server, authority)
    handed = onboarding.renew(members, change, passphrase)
    return _members.close(arguments, declaration, handed, server, authority)


def _chosen(arguments: Arguments, membership: MembershipList) -> tuple[Member, ...]:
    from datetime import UTC, datetime

    from atlantis_netcfg.core.errors import NothingMatched, UsageError
    from atlantis_netcfg.operations.vpn.records import expires, find, period

    name, within = arguments.optional("name"), arguments.optional("all")
    if (name is None) == (within is None):
        raise UsageError("which member's certificate should be renewed?", hint="add `name=iqua-sparus2`, or `all=30d`")
    if name is not None:
        return (find(membership, name),)
    end = datetime.now(UTC) + period(str(within), "all")
    due = tuple(
        member for member in membership.members.values() if (last := expires(member)) is not None and last <= end
    )
    if not due:
        raise NothingMatched(f"no certificate ends within {within}", hint="`provision vpn list` shows when they end")
    return due
