"""Commands of the VPN's authority: `vpn init`, `vpn audit`, `vpn list`, `vpn show`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli.vpn._common import AGAIN, AUTHORITY
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.identity import Certificate, Member


VPN_INIT = syntax.CommandSpec(
    "vpn init",
    "create the certificate authority and the server's certificate",
    words=(
        syntax.Word("sealed", "how to encrypt the CA key (default: age)", choices=("age", "vault")),
        AUTHORITY,
        syntax.INVENTORY,
    ),
    flags=(PASSPHRASE_FD, syntax.JSON),
    details=(
        "Run it once per pilot, on one computer. Without the passphrase, which cannot be recovered, nobody can "
        "enrol, renew or revoke; `docs/vpn.md` says what to copy where."
    ),
    changes=True,
    again=AGAIN,
)


def run_vpn_init(arguments: syntax.Arguments) -> ExitCode:
    """Create the authority, unless it exists."""
    from atlantis_netcfg.cli.base.passphrase import choose_passphrase
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.members import existing_authority, refuse_example_authority, server_names
    from atlantis_netcfg.vpn.pki import SEAL_GUESSES, VAULT_GUESSES, check_passphrase

    inventory, folder = _common.load_inventory(arguments), _common.folder(arguments)
    refuse_example_authority(inventory, is_explicit=arguments.optional("authority") is not None)
    there = existing_authority(folder, inventory)
    authority = there
    if authority is None:
        vault = arguments.optional("sealed") == "vault"
        guesses = VAULT_GUESSES if vault else SEAL_GUESSES
        passphrase = choose_passphrase(arguments, lambda text: check_passphrase(text, guesses))
        authority = Authority.init(
            folder, passphrase, server_names(inventory), _common.who(), "vault" if vault else "age"
        )
    names = authority.server()
    values = {
        "authority": str(folder),
        "already": there is not None,
        "server": {
            "name": names.common_name,
            "dns": list(names.dns),
            "addresses": [str(address) for address in names.addresses],
        },
    }
    lines = [
        msg(f"{'unchanged' if there else 'created'}: VPN authority in {arg(folder)}"),
        msg(
            f"  its server is {arg(names.common_name)}, reachable at "
            f"{arg(join(', ', [*names.dns, *map(str, names.addresses)]))}"
        ),
    ]
    if there is None:
        lines.append(
            "  copy the folder to a second place and store the passphrase in a third: neither can be recreated"
        )
    if there is None and (memory := authority.opening_bytes()):
        lines.append(msg(f"  decrypting its key takes about a second and {arg(memory >> 20)} MiB of memory"))
    return _common.tell(arguments, ExitCode.DONE, values, lines)


VPN_AUDIT = syntax.CommandSpec(
    "vpn audit",
    "show who changed members, and verify the signed record",
    words=(
        syntax.Word("since", "from this date, or this many days or weeks back", example="2026-11-01"),
        syntax.Word("partner", "only devices of this partner", example="iqua"),
        AUTHORITY,
    ),
    flags=(syntax.JSON,),
    details=(
        "The record is compared with its signature, the certificates and the revocation list. Exit code 6: they do "
        "not match; the record was changed outside provision, is damaged or incomplete."
    ),
)


def run_vpn_audit(arguments: syntax.Arguments) -> ExitCode:
    """Print the audit entries, oldest first."""
    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.reports import audit, start_of

    since = arguments.optional("since")
    start = start_of(since) if since is not None else None
    result = audit(_common.open_authority(arguments), start, arguments.optional("partner"))
    rows = [(f"{item.at:%Y-%m-%d %H:%M:%S}", item.who, item.words) for item in result.entries]
    agreement = result.agreement
    values = {
        "agrees": not result.broken,
        "lines": agreement.lines if agreement is not None else None,
        "signed_lines": agreement.signed_lines if agreement is not None else 0,
        "signed_at": agreement.at.isoformat() if agreement is not None and agreement.at is not None else None,
        "entries": [entry.facts() for entry in result.entries],
    }
    lines = [*_common.table(rows), *result.words]
    return _common.tell(
        arguments, ExitCode.CHECKS_FAILED if result.broken else ExitCode.DONE, values, lines, errors=result.broken
    )


VPN_LIST = syntax.CommandSpec(
    "vpn list",
    "list members and expiry dates",
    words=(syntax.Word("partner", "only devices of this partner", example="iqua"), AUTHORITY),
    flags=(syntax.JSON,),
)


def run_vpn_list(arguments: syntax.Arguments) -> ExitCode:
    """List the members, in the order of their onboarding."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn import reports

    now = datetime.now(UTC)
    members = reports.of_partner(_common.open_authority(arguments).membership(), arguments.optional("partner"))
    rows = [(msg("name"), msg("kind"), msg("address"), msg("until"), msg("last seen"), msg("state"))]
    for member in members:
        until = reports.expires(member)
        last_seen = max(
            (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
        )
        rows.append(
            (
                member.name,
                str(member.kind),
                str(member.address),
                f"{until:%Y-%m-%d}" if until is not None else "-",
                reports.when(last_seen),
                reports.status_of(member, now),
            )
        )
    values = {"members": [reports.member_row(member, now) for member in members]}
    return _common.tell(arguments, ExitCode.DONE, values, _common.table(rows))


VPN_SHOW = syntax.CommandSpec(
    "vpn show",
    "show a member and its certificates",
    words=(syntax.Word("name", "the member", is_required=True, example="iqua-sparus2"), AUTHORITY),
    flags=(syntax.JSON,),
)


def run_vpn_show(arguments: syntax.Arguments) -> ExitCode:
    """Show one member."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli.vpn import _common
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn import reports

    now = datetime.now(UTC)
    member = reports.find(_common.open_authority(arguments).membership(), arguments.word("name"))
    lines = _lines(member, reports.status_of(member, now))
    return _common.tell(arguments, ExitCode.DONE, {"member": reports.member_row(member, now)}, lines)


def _lines(member: Member, standing: str) -> Iterator[str]:
    whose = msg(f"of {arg(member.partner)}" if member.partner is not None else "of the pilot itself")
    vehicle = msg(f", vehicle {arg(member.vehicle)}" if member.vehicle is not None else "")
    yield msg(f"{arg(member.name)}: {arg(member.kind)} {arg(whose)}{arg(vehicle)}, {arg(standing)}")
    yield msg(f"  address {arg(member.address)}, timers for {arg(member.link)}")
    for certificate in member.certificates:
        yield from _certificate(certificate)


def _certificate(certificate: Certificate) -> Iterator[str]:
    from atlantis_netcfg.vpn.reports import when

    until, last_seen = when(certificate.not_after), when(certificate.seen)
    yield msg(
        f"  {arg(certificate.common_name)}: {arg(certificate.standing)}, valid until {arg(until)}, last seen "
        f"{arg(last_seen)}"
    )
    yield msg(f"    {arg(certificate.key)} key, {arg(certificate.wrap)}, serial {arg(certificate.serial):x}")
    if certificate.revoked is not None:
        yield msg(
            "    revoked "
            f"{arg(when(certificate.revoked))}{f': {arg(certificate.reason)}' if certificate.reason else ''}"
        )
