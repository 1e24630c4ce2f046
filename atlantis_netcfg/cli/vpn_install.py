"""`provision vpn install`: bring a site's router into the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, VIA, Command, Flag, Word
from atlantis_netcfg.cli._vpn import AUTHORITY
from atlantis_netcfg.core import printable

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.router import Installed

COMMAND = Command(
    "vpn install",
    "bring a site's router into the VPN: its certificate, its keys and its client, as far as its RouterOS can",
    words=(Word("host", "the router", required=True, example="coastal-router"), VIA, AUTHORITY, INVENTORY),
    flags=(
        Flag("plan", "say what would be done, change nothing", harmless=True),
        Flag("rehearse", "the same against an emulated router", harmless=True),
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


def run(arguments: Arguments) -> ExitCode:
    """Look, ask, install, read back."""
    from pathlib import Path

    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.declaration import ALL, choose, load

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


def _installed(opened: Session) -> ExitCode:
    import json

    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.cli._consent import agreed
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.vpn.router import identity_for, install

    arguments, (host,) = opened.arguments, opened.hosts
    request = opened.request(Mode.APPLY).model_copy(update={"authority": _vpn.folder(arguments)})
    identity = identity_for(opened.declaration, host, request)
    with progress(quiet=opened.as_json) as notify:
        found = install(opened.declaration, host, identity, request, notify, plan=True)
    if found.exit is ExitCode.CHANGES and not arguments.flag("plan"):
        if not (arguments.flag("yes") or opened.rehearsed):
            _show(opened, found)
            agreed(f"Change {host.name} now")
        with progress(quiet=opened.as_json) as notify:
            found = install(opened.declaration, host, identity, request, notify)
    if opened.as_json:
        errors = [] if found.exit in {ExitCode.DONE, ExitCode.CHANGES} else [_error(found)]
        print(json.dumps({**found.as_json(), "errors": errors, "rehearsed": opened.rehearsed}, ensure_ascii=False))
        return found.exit
    _show(opened, found)
    print(f"{found.device}: {printable.below(found.message, 4)}")
    for line in filter(None, [found.hint, f"recorded as {found.run}" if found.run else None]):
        print(f"  {printable.below(line, 4)}")
    return found.exit


def _error(found: Installed) -> dict[str, str | None]:
    return {"message": f"{found.device}: {found.message}", "hint": found.hint}


def _show(opened: Session, found: Installed) -> None:
    if not opened.as_json:
        for line in (*found.changes, *(f"note: {note}" for note in found.notes)):
            print(f"  {printable.below(line, 4)}", flush=True)
