"""Commands that look at devices and care for them: `drift`, `backup`, `verify`, `restore`, `upgrade`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base.arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    CHANGE,
    INVENTORY,
    JSON,
    ONLY,
    PROFILE,
    VERBOSE,
    VIA,
    Arguments,
    CommandSpec,
    Flag,
    Group,
    Word,
)
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.upgrade import PreparedUpgrade, Upgraded
    from atlantis_netcfg.operations.verify import VerifiedDevice, Verifying
    from atlantis_netcfg.runs import Run, SavedState
    from atlantis_netcfg.runs.report.drift import DriftReport


DRIFT = CommandSpec(
    "drift",
    "say what differs from the declaration, who owns it and since when, changing nothing",
    group=Group.FIRST,
    words=(
        Word("site", "the site; all of them if left out", example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("limit", "the same as `only=`, as Ansible calls it", takes="HOSTS"),
        Flag("junit", "write a JUnit file for a build server: a suite a device, a case a menu", takes="FILE"),
        Flag("rehearse", "the same against emulated devices of the site, as they are after `provision adopt`"),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details="Exit code 6 says that something differs, 0 that nothing does, 4 that a device could not be read.",
)


def run_drift(arguments: Arguments) -> ExitCode:
    """Read every device, compare, report."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import ALL
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.runs.report.drift import junit

    file = _file(arguments.value("junit"))
    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional("via"),
        site=arguments.optional("site") or ALL,
        only=[*arguments.many("only"), *filter(None, (arguments.value("limit") or "").split(","))],
    ) as opened:
        report = _report(opened, opened.perform(Mode.DRIFT).devices)
    if file is not None:
        _write(file, junit(report))
    print(json_text(report.as_json()) if opened.as_json else translate(report.as_text().rstrip()))
    return report.exit


def _report(opened: CommandSession, devices: Mapping[str, Mapping[str, Any]]) -> DriftReport:
    from atlantis_netcfg.runs.report.drift import DriftReport

    unfinished = _unfinished(opened)
    return DriftReport(
        site=opened.site,
        rehearsed=opened.rehearsed,
        devices=devices,
        not_handled={
            host.name: host.device.kind
            for host in opened.hosts
            if host.name not in devices and host.name not in opened.left_out
        },
        left_out=opened.left_out,
        unfinished={host: run.id for host, run in unfinished.items()},
        next_commands={host: run.next_command for host, run in unfinished.items()},
        time_zone=opened.declaration.pilot.time_zone,
    )


def _unfinished(opened: CommandSession) -> dict[str, Run]:
    """The runs that left the outcome on one of these devices open; of emulated devices none is left."""
    if opened.rehearsed:
        return {}
    sites = {host.name: host.site for host in opened.asked}
    runs = [run for site in sorted(set(sites.values())) for run in opened.store.unfinished(site)]
    return {host: run for run in runs for host in run.unsettled if host in sites}


def _file(name: str | None) -> Path | None:
    """Where to write, looked at before any device is asked. Raises UsageError."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError

    if name is None:
        return None
    path = Path(name)
    if path.is_dir() or not path.parent.is_dir():
        why = "that is a folder" if path.is_dir() else f"there is no folder {path.parent}"
        raise UsageError(
            f"`--junit {name}`: {why}", hint="name a file in a folder that exists, as in `--junit drift.xml`"
        )
    return path


def _write(path: Path, data: bytes) -> None:
    """Put the whole file there at once: a build server may look at any moment."""
    from atlantis_netcfg.core.atomic_files import write_atomically
    from atlantis_netcfg.core.errors import UsageError

    try:
        write_atomically(path, data, mode=None)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(f"{path} cannot be written: {reason}", hint="name another file with `--junit`") from error


BACKUP = CommandSpec(
    "backup",
    "save the full state of a site's devices, changing nothing",
    group=Group.TROUBLE,
    words=(
        Word("site", "the site, or `all`", required=True, example="coastal"),
        ONLY,
        INVENTORY,
    ),
    flags=(
        Flag(
            "rehearse",
            "the same against emulated devices of the site, as they are after `provision adopt`",
            harmless=True,
        ),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
        VERBOSE,
    ),
    details=(
        "The saved export hides secrets, as RouterOS does; they are not in the backup.\n"
        "What a rehearsal saves is kept with the runs of rehearsals, and no real command takes it."
    ),
)


def run_backup(arguments: Arguments) -> ExitCode:
    """Save an export of each device under a run of its own."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations import Mode

    with session(arguments, rehearse=arguments.flag("rehearse")) as opened:
        if opened.rehearsed:
            announce(opened)
        report = opened.perform(Mode.BACKUP)
    return opened.close(report)


VERIFY = CommandSpec(
    "verify",
    "show which assumptions about RouterOS or RutOS hold on a device, with evidence",
    group=Group.DEVICE,
    words=(
        Word(
            "device", "a RouterOS device or a RutOS unit", required=True, example="coastal-router", values=Values.HOST
        ),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("try", "also what needs a write: scratch rows under safe mode, taken back at once"),
        Flag("silence", "also what takes ten minutes: a session that holds safe mode and falls silent"),
        Flag("rehearse", "the same with the emulated device", harmless=True),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Without `--try` the device is only read. The report is also written to a file that can be sent back. Exit "
        "code 0: what was shown holds, 6: something does not hold or gave no usable answer, 7: nothing was shown."
    ),
    changes=True,
    again="type the same again: scratch rows go with their session, by the safe mode of the device",
)


def run_verify(arguments: Arguments) -> ExitCode:
    """Ask what it may cost, ask the device, tell."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.verify import Verifying, written

    name = arguments.word("device")
    silence = arguments.flag("silence") and not arguments.flag("rehearse")
    _check_privilege(silence=silence)
    found: list[Host] = []

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        found.append(_host(declaration, name, tries=arguments.flag("try") or arguments.flag("silence")))
        return tuple(found)

    with session(
        arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via"), site="", chosen=chosen
    ) as opened:
        (host,) = found
        opened.site = host.site
        refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
        with progress(quiet=opened.as_json) as notify:
            verifying = Verifying(
                opened.declaration,
                host,
                opened.request(Mode.DRIFT),
                notify,
                tries=arguments.flag("try"),
                silence=silence,
            )
            _pay(opened, verifying)
            verified = _verified(opened, verifying)
        # What an emulated device does is no news to anybody.
        result = verified if opened.rehearsed else written(verified, opened.state)
    print(json_text(result.as_json()) if opened.as_json else translate(result.as_text()))
    return result.exit


def _check_privilege(*, silence: bool) -> None:
    """Refuse before any device is asked. Raises UsageError."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.routeros.api import may_cut_off

    if silence and not may_cut_off():
        raise UsageError(
            "`--silence`: this computer lets only root make a connection fall silent; no device was contacted",
            hint="type the same with `sudo`, or without `--silence`",
        )


def _host(declaration: Declaration, name: str, *, tries: bool) -> Host:
    from atlantis_netcfg.core.errors import UsageError, nearest
    from atlantis_netcfg.inventory.model import LteDriver, LteRouter
    from atlantis_netcfg.operations.common.kinds import handled

    if name in declaration.hosts:
        host = declaration.hosts[name]
        is_rutos = isinstance(host.device, LteRouter) and host.device.driver is LteDriver.RUTOS
        if is_rutos and tries:
            raise UsageError(f"{name} runs RutOS and is only read", hint="leave out `--try` and `--silence`")
        if not handled(host) and not is_rutos:
            raise UsageError(f"{name} is a {host.device.kind.replace('_', ' ')}, and no RouterOS device")
        return host
    near = nearest(name, declaration.hosts)
    raise UsageError(
        f"no device is called `{name}`",
        hint=f"did you mean `device={near}`?" if near else f"there are: {', '.join(declaration.hosts)}",
    )


def _verified(opened: CommandSession, verifying: Verifying) -> VerifiedDevice:
    """Ask; where rows are added nobody else may work at the site meanwhile."""
    if not (verifying.tries or verifying.silence):
        return verifying.run()
    with opened.store.lock(opened.site, f"provision verify device={verifying.host.name} --try"):
        return verifying.run()


def _pay(opened: CommandSession, verifying: Verifying) -> None:
    """Tell what it costs where that is paid by the byte. Raises CostRefused; a rehearsal costs nothing."""
    from atlantis_netcfg.cli.base.consent import pay

    cost = verifying.cost
    if opened.rehearsed or not cost.link.metered:
        return
    if cost.over_cap:
        raise cost.refusal()
    pay([cost.words], accepted=opened.arguments.flag(ACCEPT_COST.name), as_json=opened.as_json)


RESTORE = CommandSpec(
    "restore",
    "put the state that a run has read back on a replacement device",
    group=Group.DEVICE,
    words=(
        Word("device", "the device that is replaced", required=True, example="coastal-router", values=Values.HOST),
        Word("site", "its site, if you want that checked", example="coastal"),
        Word(
            "to",
            "the run whose state it gets, as `provision runs` lists it, or `latest`",
            required=True,
            example="latest",
            values=Values.RUN_OR_LATEST,
        ),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "show what would change and what it costs, change nothing", harmless=True),
        Flag("rehearse", "the same on an emulated device, fresh from `provision adopt`", harmless=True),
        PROFILE,
        Flag("yes", "do not ask before changing the device"),
        *CHANGE,
    ),
    details=(
        "Meet the replacement first: `provision adopt --replaced` gives it our user and a certificate of its own.\n"
        "Secrets are not in a saved state: they are taken from the declaration, and what it lacks is named."
    ),
    changes=True,
    plays=True,
)


def run_restore(arguments: Arguments) -> ExitCode:
    """Find the state, show what it changes on the device, ask, apply, read back."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import ALL
    from atlantis_netcfg.operations.restore import confirmed_state

    rehearsed = arguments.flag("rehearse")
    with session(
        arguments,
        rehearse=rehearsed,
        via=arguments.optional("via"),
        site=arguments.optional("site") or ALL,
        only=[arguments.word("device")],
    ) as opened:
        (host,) = opened.hosts
        opened.site = host.site
        state = confirmed_state(opened.state, host, arguments.word("to"), rehearsed=rehearsed)
        opened.restore = state.run
        _tell(opened, state)
        if arguments.flag("plan"):
            report = opened.plan()
        elif opened.rehearsal is not None:
            from atlantis_netcfg.cli.base.rehearsal import announce, rehearse

            announce(opened)
            report = rehearse(opened, opened.rehearsal)
        else:
            report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)


def _tell(opened: CommandSession, state: SavedState) -> None:
    """Say what is put where: after the first run on the replacement, `latest` is a state of its own."""
    if opened.as_json:
        return
    from atlantis_netcfg.core.times import time_text

    run = opened.store.run(opened.site, state.run) if not opened.rehearsed else None
    when = time_text(state.at, opened.declaration.pilot.time_zone)
    print(translate(f"{opened.hosts[0].name}: the state that run {state.run} read back at {when}"), flush=True)
    if run is not None and run.started is not None and run.started.revision != opened.declaration.revision:
        print(
            translate(f"  the inventory has changed: `provision site={opened.site}` brings what it declares now"),
            flush=True,
        )


UPGRADE = CommandSpec(
    "upgrade",
    "put given RouterOS packages on one device, reboot it, and read back what runs",
    group=Group.DEVICE,
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("device", "the device of it", required=True, example="coastal-router", values=Values.HOST),
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
        PROFILE,
        Flag("yes", "do not ask before sending and rebooting"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details="Nothing is downloaded. The device reboots; what it feeds and carries is down meanwhile.",
    changes=True,
    again="type the same again: it looks at what runs on the device, and goes on from there",
)


def run_upgrade(arguments: Arguments) -> ExitCode:
    """Read the files, look at the device, show, ask, send, reboot, read back."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.upgrade import PreparedUpgrade, WaitingUpgrade

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
        prepared = PreparedUpgrade.of(
            opened.declaration,
            host,
            files,
            looking,
            notify,
            give_up=arguments.many("drop"),
            # An emulated router is back within seconds, however far away its bearer is.
            waiting=WaitingUpgrade(poll_s=1.0, connect_s=10.0) if opened.rehearsed else WaitingUpgrade(),
        )
        if not prepared.upgrade.send:
            return _close(opened, prepared.unchanged())
        _show(opened, prepared)
        prepared.affordable(request)
        if arguments.flag("plan"):
            return _close(opened, prepared.planned())
        accepted = _ask(opened, prepared, request)
        return _close(opened, prepared.carry_out(opened.declaration, accepted))


def _show(opened: CommandSession, prepared: PreparedUpgrade) -> None:
    """Print what would be sent, what it costs, and what it brings with it."""
    from atlantis_netcfg.core import printable

    if opened.as_json:
        return
    seen, upgrade = prepared.seen.installed, prepared.upgrade
    print(translate(f"{prepared.job.name}: {printable.line(seen.board)}, RouterOS {seen.version} -> {upgrade.version}"))
    for package in upgrade.send:
        print(
            translate(f"  send {package.path.name:<34} {package.size / 1e6:6.1f} MB   SHA-256 {package.sha256[:16]}…")
        )
    dear = ", which is paid by the byte" if prepared.bearer.metered else ""
    cost = f"{upgrade.size / 1e6:.1f} MB over {prepared.bearer.name}{dear}: about {prepared.seconds:.0f} s"
    print(translate(f"  {cost}; then a reboot"))
    if prepared.bearer.metered:
        print(translate(f"  {prepared.cost.words}"))
    for note in upgrade.notes:
        print(translate(f"  note: {note}"))


def _ask(opened: CommandSession, prepared: PreparedUpgrade, request: Request) -> Request:
    """Ask for a person's money, then for the reboot; return the request with the first answer."""
    from atlantis_netcfg.cli.base.consent import agreed, pays

    if opened.rehearsal is not None:
        return request
    if prepared.bearer.metered and not request.accept_cost:
        pays([prepared.cost.words], ask=not opened.as_json)
        request = request.model_copy(update={"accept_cost": True})
    if not opened.arguments.flag("yes"):
        agreed(f"Send {prepared.upgrade.size / 1e6:.1f} MB and reboot {prepared.job.name} now?")
    return request


def _close(opened: CommandSession, upgraded: Upgraded) -> ExitCode:
    from atlantis_netcfg.core import printable

    if opened.as_json:
        print(json_text(upgraded.as_json()))
        return upgraded.exit
    print(f"  {upgraded.device:<18} {printable.below(translate(upgraded.message), 21)}")
    for line in filter(None, (upgraded.hint, *(f"note: {note}" for note in upgraded.notes))):
        print(f"  {'':<18} {printable.below(translate(line), 21)}")
    if upgraded.run:
        print(translate(f"  recorded as {upgraded.run}"))
    return upgraded.exit
