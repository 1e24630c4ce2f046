"""`provision upgrade`: another RouterOS on one device, from files that a person gives."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.upgrade import Prepared, Upgraded

COMMAND = Command(
    "upgrade",
    "put given RouterOS packages on one device, reboot it, and read back what runs",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("device", "the device of it", required=True, example="coastal-router"),
        Word(
            "packages",
            "the `.npk` files, all of one version",
            required=True,
            many=True,
            example="routeros-7.21.5-arm64.npk",
        ),
        Word("drop", "installed packages to lose, for which there is no file", many=True, example="container"),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "show what would happen and what it costs, change nothing", harmless=True),
        Flag("rehearse", "the same against the emulated device", harmless=True),
        Flag("yes", "do not ask before sending and rebooting"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details="Nothing is downloaded. The device reboots; what it feeds and carries is down meanwhile.",
    changes=True,
    again="type the same again: it looks at what runs on the device, and goes on from there",
)


def run(arguments: Arguments) -> ExitCode:
    """Read the files, look at the device, show, ask, send, reboot, read back."""
    from pathlib import Path

    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.upgrade import Prepared, Waiting

    with (
        session(
            arguments,
            rehearse=arguments.flag("rehearse"),
            via=arguments.optional("via"),
            only=[arguments.word("device")],
        ) as opened,
        progress(quiet=opened.as_json) as notify,
    ):
        (host,) = opened.hosts
        looking = opened.paid(opened.request(Mode.PLAN))
        request = opened.request(Mode.APPLY)
        files = [Path(name) for name in arguments.many("packages")]
        prepared = Prepared.of(
            opened.declaration,
            host,
            files,
            looking,
            notify,
            give_up=arguments.many("drop"),
            # An emulated router is back within seconds, however far away its bearer is.
            waiting=Waiting(poll_s=1.0, connect_s=10.0) if opened.rehearsed else Waiting(),
        )
        if not prepared.upgrade.send:
            return _close(opened, prepared.unchanged())
        _show(opened, prepared)
        prepared.affordable(request)
        if arguments.flag("plan"):
            return _close(opened, prepared.planned())
        accepted = _ask(opened, prepared, request)
        return _close(opened, prepared.carry_out(opened.declaration, accepted))


def _show(opened: Session, prepared: Prepared) -> None:
    """Print what would be sent, what it costs, and what it brings with it."""
    from atlantis_netcfg.core import printable

    if opened.as_json:
        return
    seen, upgrade = prepared.seen.installed, prepared.upgrade
    print(f"{prepared.job.name}: {printable.line(seen.board)}, RouterOS {seen.version} -> {upgrade.version}")
    for package in upgrade.send:
        print(f"  send {package.path.name:<34} {package.size / 1e6:6.1f} MB   SHA-256 {package.sha256[:16]}…")
    dear = ", which is paid by the byte" if prepared.bearer.metered else ""
    cost = f"{upgrade.size / 1e6:.1f} MB over {prepared.bearer.name}{dear}: about {prepared.seconds:.0f} s"
    print(f"  {cost}; then a reboot")
    if prepared.bearer.metered:
        print(f"  {prepared.cost.words}")
    for note in upgrade.notes:
        print(f"  note: {note}")


def _ask(opened: Session, prepared: Prepared, request: Request) -> Request:
    """Ask for a person's money, then for the reboot; return the request with the first answer."""
    from atlantis_netcfg.cli._consent import agreed, pays

    if opened.rehearsal is not None:
        return request
    if prepared.bearer.metered and not request.accept_cost:
        pays([prepared.cost.words], ask=not opened.as_json)
        request = request.model_copy(update={"accept_cost": True})
    if not opened.arguments.flag("yes"):
        agreed(f"Send {prepared.upgrade.size / 1e6:.1f} MB and reboot {prepared.job.name} now")
    return request


def _close(opened: Session, upgraded: Upgraded) -> ExitCode:
    import json

    from atlantis_netcfg.core import printable

    if opened.as_json:
        print(json.dumps(upgraded.as_json(), ensure_ascii=False))
        return upgraded.exit
    print(f"  {upgraded.device:<18} {printable.below(upgraded.message, 21)}")
    for line in filter(None, (upgraded.hint, *(f"note: {note}" for note in upgraded.notes))):
        print(f"  {'':<18} {printable.below(line, 21)}")
    if upgraded.run:
        print(f"  recorded as {upgraded.run}")
    return upgraded.exit
