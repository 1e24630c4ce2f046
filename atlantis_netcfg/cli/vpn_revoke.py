"""`provision vpn revoke`: put members out of the VPN, for good, and see that they are out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Flag, Word
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, CLOCK, INVENTORY, NO_PUSH

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.identity import Member, MembershipList

COMMAND = Command(
    "vpn revoke",
    "put members out of the VPN for good: list, session and connections, and ask the server whether they are dead",
    words=(
        Word("name", "the member", example="iqua-sparus2"),
        Word("partner", "every device of this partner", example="iqua"),
        Word("reason", "for the record, one line", example="stolen"),
        CLOCK,
        AUTHORITY,
        INVENTORY,
    ),
    flags=(Flag("yes", "do not ask before they are cut off"), NO_PUSH, PASSPHRASE_FD, JSON),
    details=(
        "A name never returns. Exit code 5 says that it is recorded, and that the server did not answer: whoever is "
        "connected stays so until `provision vpn sync` has reached it."
    ),
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Ask, record, publish the list, end the sessions, look."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import passphrase_prompt
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.operations.vpn.members import reason_of, revoke

    declaration = _vpn.declared(arguments)
    reason = reason_of(arguments.optional("reason"))
    authority = _vpn.opened(arguments)
    members = _chosen(arguments, authority.membership())
    server = _vpn.server(arguments, declaration)
    passphrase = passphrase_prompt(arguments)
    _members.hold(arguments, server, authority)
    _agree(arguments, members)
    revoked = revoke(_vpn.operator(arguments, authority), members, reason, passphrase)
    with progress(quiet=arguments.flag("json")) as notify:
        cut = server.cut(authority, revoked, notify)
    return _members.close_revoked(arguments, revoked, cut)


def _chosen(arguments: Arguments, membership: MembershipList) -> tuple[Member, ...]:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations.vpn.records import find, of_partner

    name, partner = arguments.optional("name"), arguments.optional("partner")
    if (name is None) == (partner is None):
        raise UsageError(
            "which member should be revoked?", hint="add `name=iqua-sparus2`, or `partner=iqua` for all of them"
        )
    return (find(membership, name),) if name is not None else of_partner(membership, partner)


def _agree(arguments: Arguments, members: tuple[Member, ...]) -> None:
    """Show what will be cut, and return when a person agrees. Raises Declined, UsageError."""
    from atlantis_netcfg.cli._consent import agreed
    from atlantis_netcfg.operations.vpn.records import when

    if arguments.flag("yes") or not any(member.good for member in members):
        return
    if not arguments.flag("json"):
        for member in members:
            seen = max(
                (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
            )
            print(f"  {member.name}: {member.kind}, {member.address}, last seen {when(seen)}", flush=True)
    agreed("Cut them off now, for good" if len(members) > 1 else f"Cut {members[0].name} off now, for good")
