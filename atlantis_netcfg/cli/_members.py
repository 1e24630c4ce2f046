"""How the commands that change who is in the VPN tell what became of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Any

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.operations.vpn.members import HandedOut, HandoutTarget
    from atlantis_netcfg.operations.vpn.server import Deployed, Server
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.model import RevocationResult
    from atlantis_netcfg.vpn.identity import Member


def outlet(arguments: Arguments, recipients: Mapping[str, str]) -> HandoutTarget:
    """How hand-outs leave. Raises UsageError for a folder that is none, and a contact that is no line."""
    from pathlib import Path

    from atlantis_netcfg.operations.vpn.members import CONTACT, HandoutTarget

    to, contact = arguments.optional("to"), arguments.optional("contact")
    return HandoutTarget(recipients, Path(to) if to is not None else None, contact if contact is not None else CONTACT)


def hold(arguments: Arguments, server: Server, authority: Authority) -> None:
    """Hold the record against the server, before anything is signed. Raises RecordOlder."""
    from atlantis_netcfg.cli._progress import progress

    with progress(quiet=arguments.flag("json")) as notify:
        server.hold(authority, notify)


def close(
    arguments: Arguments,
    declaration: Declaration,
    handed: Sequence[HandedOut],
    server: Server,
    authority: Authority,
) -> ExitCode:
    """Tell what was issued, its one-time passphrases among it, then bring it to the server and tell that.

    A passphrase is printed before the server is asked: who stops a command that waits for it has lost nothing.
    """
    from atlantis_netcfg.cli import _vpn

    if not arguments.flag("json"):
        for line in (line for entry in handed for line in _lines(declaration, entry)):
            print(line, flush=True)
    deployed = _deployed(arguments, server, authority)
    values = {"members": [_row(item) for item in handed], **deployed.as_json()}
    return _vpn.tell(arguments, deployed.exit, values, deployed.lines, deployed.errors)


def _deployed(arguments: Arguments, server: Server, authority: Authority) -> Deployed:
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.cli._vpn import AGAIN
    from atlantis_netcfg.core.errors import OutcomeUnknown
    from atlantis_netcfg.operations.vpn.server import Deployed

    try:
        with progress(quiet=arguments.flag("json")) as notify:
            return server.deploy(authority, notify)
    except KeyboardInterrupt:
        stopped = OutcomeUnknown("stopped by Ctrl-C before the server was seen to have it", hint=AGAIN)
        return Deployed(errors=(stopped,), deployed=False)


def _row(handed: HandedOut) -> dict[str, Any]:
    """A member for programs; `passphrase` is the only secret that a command tells, and only this once."""
    from datetime import UTC, datetime

    from atlantis_netcfg.operations.vpn.records import member_row

    return {
        **member_row(handed.issued.member, datetime.now(UTC)),
        "common_name": handed.issued.certificate.common_name,
        "already": handed.issued.already,
        "replaced": list(handed.issued.replaced),
        "file": str(handed.file),
        "copy": str(handed.copy) if handed.copy is not None else None,
        "sha256": handed.issued.delivered.sha256,
        "passphrase": handed.passphrase.reveal() if handed.passphrase is not None else None,
    }


def _lines(declaration: Declaration, handed: HandedOut) -> Iterator[str]:
    member, certificate = handed.issued.member, handed.issued.certificate
    what = "already so" if handed.issued.already else certificate.common_name
    yield f"{member.name}: {what}, address {member.address}, good until {certificate.not_after:%Y-%m-%d}"
    yield f"  file        {handed.copy or handed.file}"
    if handed.issued.already:
        yield f"              made before; if its passphrase is lost: provision vpn renew name={member.name}"
        return
    if handed.passphrase is not None:
        yield f"  passphrase  {handed.passphrase.reveal()}"
        yield "              shown this once: tell it by telephone, never in the message that the file goes with"
    for gone in handed.issued.replaced:
        yield f"  revoked     {gone}, which was handed out before and never used"
    if member.partner is None:
        yield f"              `{bringing(declaration, member)}` brings it there"
    else:
        yield "              the partner opens it with age, and goes on with README.txt inside"


def bringing(declaration: Declaration, member: Member) -> str:
    """The command that brings a declared computer its identity."""
    from atlantis_netcfg.vpn.identity import Kind

    if member.kind is Kind.ROUTER:
        return f"provision vpn install host={member.name}"
    return f"provision site={declaration.hosts[member.name].site} only={member.name}"


def close_revoked(arguments: Arguments, revoked: RevocationResult, deployed: Deployed) -> ExitCode:
    """Tell who is out, and by which evidence."""
    from atlantis_netcfg.cli import _vpn

    values = {
        "members": list(revoked.members),
        "common_names": list(revoked.common_names),
        "already": list(revoked.already),
        **deployed.as_json(),
    }
    lines = [f"{name}: {'already so' if name in revoked.already else 'revoked'}" for name in revoked.members]
    return _vpn.tell(arguments, deployed.exit, values, [*lines, *deployed.lines], deployed.errors)


def close_synced(
    arguments: Arguments, deployed: Deployed, site: str | None, taken: Sequence[str] | None = None
) -> ExitCode:
    """Tell what the server was brought to; `site` is where it stands, if it has a new certificate to get there.

    `taken`: who is revoked because the server's list was taken over.
    """
    from atlantis_netcfg.cli import _vpn

    values = {**deployed.as_json(), "server_certificate": site is not None, "taken": list(taken or ())}
    lines = (
        [] if taken is None else [f"taken over from the server's list: {', '.join(taken) or 'nobody of the record'}"]
    )
    if site is not None:
        lines.append(f"the server has a new certificate: `provision site={site}` puts it in its place")
    return _vpn.tell(arguments, deployed.exit, values, (*lines, *deployed.lines), deployed.errors)
