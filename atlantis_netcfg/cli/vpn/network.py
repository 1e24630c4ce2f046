"""Commands that bring the VPN to its devices: `vpn install`, `vpn sync`, `vpn status`.

`provision vpn install`: connect a site's router to the VPN.

`provision vpn sync`: bring the VPN server to the recorded state.

`provision vpn status`: the state of the VPN, and what must be done soon.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.cli.base.passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli.vpn._common import AGAIN, AUTHORITY, CLOCK, NO_PUSH
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.router import InstalledIdentity
    from atlantis_netcfg.operations.vpn.server import VpnStatus
    from atlantis_netcfg.vpn.identity import Member


VPN_INSTALL = syntax.CommandSpec(
    "vpn install",
    "install certificate, keys and client on a site's router",
    words=(
        syntax.Word("device", "the router", is_required=True, example="coastal-router"),
        syntax.VIA,
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show the steps, change nothing", harmless=True),
        syntax.Flag("rehearse", "use an emulated router", harmless=True),
        syntax.PROFILE,
        syntax.Flag("yes", "do not ask before changing the router"),
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Uses the identity that `provision vpn onboard device=…` or `provision vpn accept` stored on this computer. "
        "RouterOS before 7.17 does not support tls-crypt and is refused."
    ),
    changes=True,
    again="run the same command again: it continues from there and removes leftover files",
)


def run_vpn_install(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn install`: read the router, ask, install, verify."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import ALL, choose, load

    pilot_inventory = load(paths.inventory_folder(arguments.optional(syntax.INVENTORY.name)))
    (host,) = choose(pilot_inventory, ALL, [arguments.word("device")])
    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional(syntax.VIA.name),
        site=host.site,
        choose_hosts=lambda inventory: choose(inventory, ALL, [host.name]),
    ) as site_session:
        return _install(site_session)


def _install(session: CommandSession) -> ExitCode:
    from atlantis_netcfg.cli.base.consent import require_agreement
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.vpn.router import identity_for, install

    arguments, (host,) = session.arguments, session.hosts
    request = session.request(Mode.APPLY).model_copy(update={"authority": _common.folder(arguments)})
    identity = identity_for(session.inventory, host, request)
    with progress(quiet=session.as_json) as notify:
        result = install(session.inventory, host, identity, request, notify, plan=True)
    if result.exit is ExitCode.CHANGES and not arguments.flag("plan"):
        if not (arguments.flag("yes") or session.is_rehearsal):
            _show(session, result)
            require_agreement(msg(f"Change {arg(host.name)} now?"))
        with progress(quiet=session.as_json) as notify:
            result = install(session.inventory, host, identity, request, notify)
    if session.as_json:
        errors = [] if result.exit in {ExitCode.DONE, ExitCode.CHANGES} else [_error(result)]
        print(json_text({**result.as_json(), "errors": errors, "rehearsed": session.is_rehearsal}))
        return result.exit
    _show(session, result)
    print(f"{result.device}: {printable.below(translate(result.message), 4)}")
    for line in filter(None, [result.hint, msg(f"recorded as {arg(result.run)}") if result.run else None]):
        print(f"  {printable.below(translate(line), 4)}")
    return result.exit


def _error(result: InstalledIdentity) -> dict[str, str | None]:
    return {"message": msg(f"{arg(result.device)}: {arg(result.message)}"), "hint": result.hint}


def _show(session: CommandSession, result: InstalledIdentity) -> None:
    if not session.as_json:
        for line in (*result.changes, *(msg(f"note: {arg(note)}") for note in result.notes)):
            print(f"  {printable.below(translate(line), 4)}", flush=True)


VPN_SYNC = syntax.CommandSpec(
    "vpn sync",
    "update the server: members, revocations, firewall, sessions",
    words=(CLOCK, AUTHORITY, syntax.INVENTORY),
    flags=(
        syntax.Flag("sign", "also re-sign the revocation list, and the server certificate if due"),
        syntax.Flag("take-list", "for `--sign`: keep what the server's list revokes, if the newest copy is lost"),
        PASSPHRASE_FD,
        syntax.JSON,
    ),
    details=(
        "Only `--sign` needs a passphrase: it signs a revocation list valid for 90 days. It also renews the "
        "server certificate if its names in the inventory have changed or 90 days are left. Exit code 5: the "
        "server was not reached."
    ),
    changes=True,
    again=AGAIN,
)


def run_vpn_sync(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn sync`: push, end revoked sessions, verify."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.passphrase import passphrase_prompt
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.cli.vpn import members as vpn_members
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.vpn.members import server_names

    inventory = _common.load_inventory(arguments)
    authority = _common.open_authority(arguments)
    server = _common.server(arguments, inventory)
    sign, take = arguments.flag("sign"), arguments.flag("take-list")
    if take and not sign:
        raise UsageError("an imported list must be signed again", hint="add `--sign`")
    passphrase = passphrase_prompt(arguments) if sign else None
    theirs = None
    if take:
        with progress(quiet=arguments.flag("json")) as notify:
            theirs = server.get_crl(notify)
    else:
        vpn_members.hold(arguments, server, authority)
    has_new_certificate, taken_names = False, None
    if passphrase is not None:
        with _common.operator(arguments, authority).unlock(passphrase) as signer:
            taken_names = signer.take(theirs) if theirs is not None else None
            signer.publish()
            has_new_certificate = signer.serve(server_names(inventory))
    with progress(quiet=arguments.flag("json")) as notify:
        deployment = server.deploy(authority, notify)
    return vpn_members.close_synced(
        arguments, deployment, _common.site(inventory) if has_new_certificate else None, taken_names
    )


VPN_STATUS = syntax.CommandSpec(
    "vpn status",
    "show sessions, expiry dates and pending changes",
    words=(syntax.Word("partner", "only devices of this partner", example="iqua"), AUTHORITY, syntax.INVENTORY),
    flags=(NO_PUSH, syntax.JSON),
    details=(
        "Exit code 6: action needed (a list or certificate expires within 30 days or has expired, the server "
        "differs from the record, a revocation is pending). 5: the server was not reached, so its state is unknown."
    ),
)


def run_vpn_status(arguments: syntax.Arguments) -> ExitCode:
    """Run `vpn status`: read the record and the server; record which members were seen."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.operations.vpn.server import RemoteServer, vpn_status
    from atlantis_netcfg.vpn import reports

    inventory = _common.load_inventory(arguments)
    authority = _common.open_authority(arguments)
    server = _common.server(arguments, inventory)
    with progress(quiet=arguments.flag("json")) as notify:
        status = vpn_status(inventory, authority, server if isinstance(server, RemoteServer) else None, notify)
    membership, partner = authority.membership(), arguments.optional("partner")
    members = reports.of_partner(membership, partner) if membership.members or partner is not None else ()
    now = datetime.now(UTC)
    values = {
        "told": [item.as_json() for item in status.items],
        "members": [reports.member_row(member, now) for member in members],
        "server": status.server_json(),
        "queued": list(membership.queued_names),
    }
    return _common.tell(arguments, status.exit, values, _lines(status, members, now))


def _lines(status: VpnStatus, members: Sequence[Member], now: datetime) -> Iterator[str]:
    from atlantis_netcfg.cli.vpn._common import table
    from atlantis_netcfg.vpn.reports import expires, status_of, when

    for entry in status.items:
        yield msg(f"{arg(entry.verdict.value):<12} {arg(entry.message)}")
        if entry.hint:
            yield from (f"{'':<12} {line}" for line in entry.hint.splitlines())
    up = {session.common_name: session for session in status.state.sessions if session.is_up} if status.state else {}
    rows = (
        [(msg("member"), msg("address"), msg("until"), msg("last seen"), msg("session"), msg("state"))]
        if members
        else []
    )
    for member in members:
        until, names = expires(member), [item.common_name for item in member.certificates]
        last_seen = max(
            (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
        )
        session = next((up[name] for name in names if name in up), None)
        rows.append(
            (
                member.name,
                str(member.address),
                f"{until:%Y-%m-%d}" if until is not None else "-",
                when(last_seen),
                msg(f"{arg(session.real)} as {arg(session.common_name)}" if session is not None else "-"),
                status_of(member, now),
            )
        )
    yield from table(rows)
