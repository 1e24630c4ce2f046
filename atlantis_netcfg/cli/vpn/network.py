"""Commands that bring the VPN to its devices: `vpn install`, `vpn sync`, `vpn status`.

`provision vpn install`: bring a site's router into the VPN.

`provision vpn sync`: bring the server of the VPN to what is recorded.

`provision vpn status`: how it stands with the VPN, and what must be done soon.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    PROFILE,
    VIA,
    CommandSpec,
    Flag,
    Group,
    Word,
)
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.cli.base.passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli.vpn._common import AGAIN, AUTHORITY, CLOCK, NO_PUSH
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from atlantis_netcfg.cli.base.arguments import Arguments
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.router import InstalledIdentity
    from atlantis_netcfg.operations.vpn.server import VpnStatus
    from atlantis_netcfg.vpn.identity import Member


VPN_INSTALL = CommandSpec(
    "vpn install",
    "bring a site's router into the VPN: its certificate, its keys and its client, as far as its RouterOS can",
    group=Group.VPN,
    words=(Word("host", "the router", required=True, example="coastal-router"), VIA, AUTHORITY, INVENTORY),
    flags=(
        Flag("plan", "say what would be done, change nothing", harmless=True),
        Flag("rehearse", "the same against an emulated router", harmless=True),
        PROFILE,
        Flag("yes", "do not ask before changing the router"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Takes the identity that `provision vpn onboard host=…` or `provision vpn accept` has left on this computer. "
        "RouterOS before 7.17 cannot wrap its control channel and is refused."
    ),
    changes=True,
    again="type the same again: it goes on from there, and removes files that were left",
)


def run_vpn_install(arguments: Arguments) -> ExitCode:
    """Look, ask, install, read back."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import ALL, choose, load

    named = arguments.optional(INVENTORY.name)
    declaration = load(Path(named) if named else paths.checkout() / "inventory")
    (host,) = choose(declaration, ALL, [arguments.word("host")])
    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional(VIA.name),
        site=host.site,
        chosen=lambda opened: choose(opened, ALL, [host.name]),
    ) as opened:
        return _installed(opened)


def _installed(opened: CommandSession) -> ExitCode:
    from atlantis_netcfg.cli.base.consent import agreed
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.vpn.router import identity_for, install

    arguments, (host,) = opened.arguments, opened.hosts
    request = opened.request(Mode.APPLY).model_copy(update={"authority": _common.folder(arguments)})
    identity = identity_for(opened.declaration, host, request)
    with progress(quiet=opened.as_json) as notify:
        found = install(opened.declaration, host, identity, request, notify, plan=True)
    if found.exit is ExitCode.CHANGES and not arguments.flag("plan"):
        if not (arguments.flag("yes") or opened.rehearsed):
            _show(opened, found)
            agreed(f"Change {host.name} now?")
        with progress(quiet=opened.as_json) as notify:
            found = install(opened.declaration, host, identity, request, notify)
    if opened.as_json:
        errors = [] if found.exit in {ExitCode.DONE, ExitCode.CHANGES} else [_error(found)]
        print(json_text({**found.as_json(), "errors": errors, "rehearsed": opened.rehearsed}))
        return found.exit
    _show(opened, found)
    print(f"{found.device}: {printable.below(translate(found.message), 4)}")
    for line in filter(None, [found.hint, f"recorded as {found.run}" if found.run else None]):
        print(f"  {printable.below(translate(line), 4)}")
    return found.exit


def _error(found: InstalledIdentity) -> dict[str, str | None]:
    return {"message": f"{found.device}: {found.message}", "hint": found.hint}


def _show(opened: CommandSession, found: InstalledIdentity) -> None:
    if not opened.as_json:
        for line in (*found.changes, *(f"note: {note}" for note in found.notes)):
            print(f"  {printable.below(translate(line), 4)}", flush=True)


VPN_SYNC = CommandSpec(
    "vpn sync",
    "bring the server to what is recorded: members, list, firewall, and sessions that must end",
    group=Group.VPN,
    words=(CLOCK, AUTHORITY, INVENTORY),
    flags=(
        Flag("sign", "also sign the list of revoked certificates anew, and the server's certificate where it is time"),
        Flag("take-list", "with --sign: take over what the server's list revokes, as the newest copy of it is lost"),
        PASSPHRASE_FD,
        JSON,
    ),
    details=(
        "Needs no passphrase without `--sign`, which makes a list that is good for 90 days, and a certificate of the "
        "server where its names in the inventory are others or 90 days are left. Exit code 5: it was not reached."
    ),
    changes=True,
    again=AGAIN,
)


def run_vpn_sync(arguments: Arguments) -> ExitCode:
    """Push, end what must end, look."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.cli.vpn import members as vpn_members
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.vpn.members import server_names

    declaration = _common.declared(arguments)
    authority = _common.opened(arguments)
    server = _common.server(arguments, declaration)
    sign, take = arguments.flag("sign"), arguments.flag("take-list")
    if take and not sign:
        raise UsageError("a list that is taken over is signed anew", hint="add `--sign`")
    passphrase = passphrase_prompt(arguments) if sign else None
    theirs = None
    if take:
        with progress(quiet=arguments.flag("json")) as notify:
            theirs = server.published(notify)
    else:
        vpn_members.hold(arguments, server, authority)
    served, taken = False, None
    if passphrase is not None:
        with _common.operator(arguments, authority).unlocked(passphrase) as signer:
            taken = signer.take(theirs) if theirs is not None else None
            signer.publish()
            served = signer.serve(server_names(declaration))
    with progress(quiet=arguments.flag("json")) as notify:
        deployed = server.deploy(authority, notify)
    return vpn_members.close_synced(arguments, deployed, _common.site(declaration) if served else None, taken)


VPN_STATUS = CommandSpec(
    "vpn status",
    "tell expiries, sessions, who was last seen when, what waits, and what differs at the server",
    group=Group.VPN,
    words=(Word("partner", "only the devices of this partner", example="iqua"), AUTHORITY, INVENTORY),
    flags=(NO_PUSH, JSON),
    details=(
        "Exit code 6: something must be done (a list or a certificate ends within 30 days or has ended, the server "
        "differs from the record, a revocation waits). 5: the server was not reached, so nobody knows."
    ),
)


def run_vpn_status(arguments: Arguments) -> ExitCode:
    """Look at the record and at the server; whoever was seen is recorded."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.operations.vpn.server import Connected, vpn_status
    from atlantis_netcfg.vpn import reports

    declaration = _common.declared(arguments)
    authority = _common.opened(arguments)
    server = _common.server(arguments, declaration)
    with progress(quiet=arguments.flag("json")) as notify:
        found = vpn_status(declaration, authority, server if isinstance(server, Connected) else None, notify)
    membership, partner = authority.membership(), arguments.optional("partner")
    members = reports.of_partner(membership, partner) if membership.members or partner is not None else ()
    now = datetime.now(UTC)
    values = {
        "told": [item.as_json() for item in found.items],
        "members": [reports.member_row(member, now) for member in members],
        "server": found.server_json(),
        "queued": list(membership.queued),
    }
    return _common.tell(arguments, found.exit, values, _lines(found, members, now))


def _lines(found: VpnStatus, members: Sequence[Member], now: datetime) -> Iterator[str]:
    from atlantis_netcfg.cli.vpn._common import table
    from atlantis_netcfg.vpn.reports import expires, status_of, when

    for entry in found.items:
        yield f"{entry.verdict.value:<12} {entry.message}"
        if entry.hint:
            yield from (f"{'':<12} {line}" for line in entry.hint.splitlines())
    up = {session.common_name: session for session in found.state.sessions if session.is_up} if found.state else {}
    rows = [("member", "address", "until", "last seen", "session", "standing")] if members else []
    for member in members:
        until, names = expires(member), [item.common_name for item in member.certificates]
        seen = max(
            (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
        )
        session = next((up[name] for name in names if name in up), None)
        rows.append(
            (
                member.name,
                str(member.address),
                f"{until:%Y-%m-%d}" if until is not None else "-",
                when(seen),
                f"{session.real} as {session.common_name}" if session is not None else "-",
                status_of(member, now),
            )
        )
    yield from table(rows)
