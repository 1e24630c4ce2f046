"""Commands for devices: `report drift`, `device backup`, `device verify`, `device restore`, `device upgrade`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.upgrade import PreparedUpgrade, UpgradeResult
    from atlantis_netcfg.operations.verify import VerifiedDevice, Verifying
    from atlantis_netcfg.runs import Run, SavedState
    from atlantis_netcfg.runs.report.drift import DriftReport


DRIFT = syntax.CommandSpec(
    "report drift",
    "show differences between devices and inventory (read-only)",
    words=(
        syntax.Word("site", "the site (default: all sites)", example="coastal"),
        syntax.DEVICES,
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("junit", "write a JUnit file: one suite per device, one case per menu", takes="FILE"),
        syntax.Flag("rehearse", "use emulated devices, as after `provision device adopt`"),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details="Exit code 6: at least one device differs, 0: no device differs, 4: a device could not be read.",
)


def run_drift(arguments: syntax.Arguments) -> ExitCode:
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
        only=arguments.many("device"),
    ) as site_session:
        report = _report(site_session, site_session.perform(Mode.DRIFT).devices)
    if file is not None:
        _write(file, junit(report))
    print(json_text(report.as_json()) if site_session.as_json else translate(report.as_text()).rstrip())
    return report.exit


def _report(session: CommandSession, devices: Mapping[str, Mapping[str, Any]]) -> DriftReport:
    from atlantis_netcfg.runs.report.drift import DriftReport

    open_runs = _unfinished_runs(session)
    return DriftReport(
        site=session.site,
        is_rehearsal=session.is_rehearsal,
        devices=devices,
        not_handled={
            host.name: host.device.kind
            for host in session.hosts
            if host.name not in devices and host.name not in session.left_out
        },
        left_out=session.left_out,
        unfinished_runs={host: run.id for host, run in open_runs.items()},
        next_commands={host: run.next_command for host, run in open_runs.items()},
        time_zone=session.inventory.pilot.time_zone,
    )


def _unfinished_runs(session: CommandSession) -> dict[str, Run]:
    """Return the unfinished runs with an unknown outcome for one of these devices; none in a rehearsal."""
    if session.is_rehearsal:
        return {}
    sites = {host.name: host.site for host in session.handled_hosts}
    runs = [run for site in sorted(set(sites.values())) for run in session.store.unfinished_runs(site)]
    return {host: run for run in runs for host in run.unsettled_devices if host in sites}


def _file(name: str | None) -> Path | None:
    """Return the output path, checked before any device is contacted. Raises UsageError."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError

    if name is None:
        return None
    path = Path(name)
    if path.is_dir() or not path.parent.is_dir():
        why = msg("this is a folder" if path.is_dir() else f"no such folder: {arg(path.parent)}")
        raise UsageError(
            f"`--junit {arg(name)}`: {arg(why)}",
            hint="give a file in an existing folder, for example `--junit drift.xml`",
        )
    return path


def _write(path: Path, data: bytes) -> None:
    """Write a file atomically, as other programs may read it at any time."""
    from atlantis_netcfg.core.atomic_files import write_atomically
    from atlantis_netcfg.core.errors import UsageError

    try:
        write_atomically(path, data, mode=None)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(f"cannot write {arg(path)}: {arg(reason)}", hint="give another file with `--junit`") from error


BACKUP = syntax.CommandSpec(
    "device backup",
    "save the full state of a site's devices (read-only)",
    words=(
        syntax.Word("site", "the site, or `all`", is_required=True, example="coastal"),
        syntax.DEVICES,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag(
            "rehearse",
            "use emulated devices, as after `provision device adopt`",
            harmless=True,
        ),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
        syntax.VERBOSE,
    ),
    details=(
        "The saved export contains no secrets, as RouterOS hides them.\nA state saved in a rehearsal is stored "
        "separately, and no real command uses it."
    ),
)


def run_backup(arguments: syntax.Arguments) -> ExitCode:
    """Save an export of each device as a separate run."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations import Mode

    with session(arguments, rehearse=arguments.flag("rehearse")) as site_session:
        if site_session.is_rehearsal:
            announce(site_session)
        report = site_session.perform(Mode.BACKUP)
    return site_session.close(report)


VERIFY = syntax.CommandSpec(
    "device verify",
    "test which RouterOS or RutOS assumptions hold on a device",
    words=(
        syntax.Word(
            "device",
            "a RouterOS device or a RutOS unit",
            is_required=True,
            example="coastal-router",
        ),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("try", "also test writing: rows under safe mode, removed at once"),
        syntax.Flag("silence", "also test a session that goes silent in safe mode (10 minutes)"),
        syntax.Flag("rehearse", "use an emulated device", harmless=True),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Without `--try` the device is only read. The report is also written to a file that you can send back. "
        "Exit code 0: all results hold, 6: an assumption does not hold or gave no usable result, 7: nothing was tested."
    ),
    changes=True,
    again="run the same command again: the device's safe mode removes scratch rows when their session ends",
)


def run_verify(arguments: syntax.Arguments) -> ExitCode:
    """Run `device verify`: ask for consent to the cost, test the device, report."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.verify import Verifying, write_report

    name = arguments.word("device")
    silence = arguments.flag("silence") and not arguments.flag("rehearse")
    _check_privilege(silence=silence)
    hosts: list[Host] = []

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        hosts.append(_host(inventory, name, tries=arguments.flag("try") or arguments.flag("silence")))
        return tuple(hosts)

    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional("via"),
        site="",
        choose_hosts=choose_hosts,
    ) as site_session:
        (host,) = hosts
        site_session.site = host.site
        refuse_examples(site_session.inventory, is_rehearsal=site_session.is_rehearsal)
        with progress(quiet=site_session.as_json) as notify:
            verifying = Verifying(
                site_session.inventory,
                host,
                site_session.request(Mode.DRIFT),
                notify,
                tries=arguments.flag("try"),
                silence=silence,
            )
            _pay(site_session, verifying)
            device = _verify(site_session, verifying)
        # What an emulated device does is no news to anybody.
        result = device if site_session.is_rehearsal else write_report(device, site_session.state)
    print(json_text(result.as_json()) if site_session.as_json else translate(result.as_text()))
    return result.exit


def _check_privilege(*, silence: bool) -> None:
    """Raise UsageError if silencing lacks privileges, before any device is contacted."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.routeros.api import may_cut_off

    if silence and not may_cut_off():
        raise UsageError(
            "`--silence`: on this computer only root can block a connection; no device was contacted",
            hint="run the same command with `sudo`, or without `--silence`",
        )


def _host(inventory: Inventory, name: str, *, tries: bool) -> Host:
    from atlantis_netcfg.core.errors import UsageError, nearest
    from atlantis_netcfg.inventory.model import LteDriver, LteRouter
    from atlantis_netcfg.operations.common.kinds import is_supported

    if name in inventory.hosts:
        host = inventory.hosts[name]
        is_rutos = isinstance(host.device, LteRouter) and host.device.driver is LteDriver.RUTOS
        if is_rutos and tries:
            raise UsageError(f"{arg(name)} runs RutOS and can only be read", hint="remove `--try` and `--silence`")
        if not is_supported(host) and not is_rutos:
            raise UsageError(f"{arg(name)} is a {arg(host.device.kind.replace('_', ' '))}, not a RouterOS device")
        return host
    near = nearest(name, inventory.hosts)
    raise UsageError(
        f"no such device: `{arg(name)}`",
        hint=f"did you mean `device={arg(near)}`?" if near else f"available: {arg(join(', ', inventory.hosts))}",
    )


def _verify(session: CommandSession, verifying: Verifying) -> VerifiedDevice:
    """Test the device; if rows are added, hold the lock of the site."""
    if not (verifying.tries or verifying.silence):
        return verifying.run()
    with session.store.lock(session.site, f"provision device verify device={verifying.host.name} --try"):
        return verifying.run()


def _pay(session: CommandSession, verifying: Verifying) -> None:
    """Show the cost on a metered link. Raises CostRefusal; a rehearsal costs nothing."""
    from atlantis_netcfg.cli.base.consent import pay

    cost = verifying.cost
    if session.is_rehearsal or not cost.link.is_metered:
        return
    if cost.over_cap:
        raise cost.refusal()
    pay([cost.words], is_accepted=session.arguments.flag(syntax.ACCEPT_COST.name), as_json=session.as_json)


RESTORE = syntax.CommandSpec(
    "device restore",
    "restore a saved configuration to a replacement device",
    words=(
        syntax.Word("device", "the device to replace", is_required=True, example="coastal-router"),
        syntax.Word("site", "its site, as a check", example="coastal"),
        syntax.Word(
            "run",
            "the run to restore, from `provision report runs`, or `latest`",
            is_required=True,
            example="latest",
            values=Values.RUN_OR_LATEST,
        ),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show changes and their cost, change nothing", harmless=True),
        syntax.Flag("rehearse", "use an emulated device, as after `provision device adopt`", harmless=True),
        syntax.PROFILE,
        syntax.Flag("yes", "do not ask before changing the device"),
        *syntax.CHANGE,
    ),
    details=(
        "Prepare the replacement first: `provision device adopt --replaced` creates our user and a certificate on "
        "it.\nA saved state has no secrets: they come from the inventory, and missing ones are listed."
    ),
    changes=True,
    plays=True,
)


def run_restore(arguments: syntax.Arguments) -> ExitCode:
    """Run `device restore`: find the state, show its changes, ask for consent, apply, verify."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import ALL
    from atlantis_netcfg.operations.restore import confirmed_state

    is_rehearsal = arguments.flag("rehearse")
    with session(
        arguments,
        rehearse=is_rehearsal,
        via=arguments.optional("via"),
        site=arguments.optional("site") or ALL,
        only=[arguments.word("device")],
    ) as site_session:
        (host,) = site_session.hosts
        site_session.site = host.site
        state = confirmed_state(site_session.state, host, arguments.word("run"), is_rehearsal=is_rehearsal)
        site_session.restore = state.run
        _tell(site_session, state)
        if arguments.flag("plan"):
            report = site_session.plan()
        elif site_session.rehearsal is not None:
            from atlantis_netcfg.cli.base.rehearsal import announce, rehearse

            announce(site_session)
            report = rehearse(site_session, site_session.rehearsal)
        else:
            report = site_session.change(ask=not arguments.flag("yes"))
    return site_session.close(report)


def _tell(session: CommandSession, state: SavedState) -> None:
    """Print which state is restored to which device; later, `latest` will be the replacement's own state."""
    if session.as_json:
        return
    from atlantis_netcfg.core.times import time_text

    run = session.store.run(session.site, state.run) if not session.is_rehearsal else None
    when = time_text(state.at, session.inventory.pilot.time_zone)
    print(
        translate(f"{arg(session.hosts[0].name)}: the state verified by run {arg(state.run)} at {arg(when)}"),
        flush=True,
    )
    if run is not None and run.start_record is not None and run.start_record.revision != session.inventory.revision:
        print(
            translate(
                f"  the inventory has changed since: `provision site={arg(session.site)}` applies the current one"
            ),
            flush=True,
        )


UPGRADE = syntax.CommandSpec(
    "device upgrade",
    "install RouterOS packages on a device, reboot it, verify",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("device", "device of the site", is_required=True, example="coastal-router"),
        syntax.Word(
            "packages",
            "`.npk` files, all of one version",
            is_required=True,
            many=True,
            example="routeros-7.21.5-arm64.npk",
        ),
        syntax.Word("drop", "installed packages to remove (those without a file)", many=True, example="container"),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show the steps and their cost, change nothing", harmless=True),
        syntax.Flag("rehearse", "use an emulated device", harmless=True),
        syntax.PROFILE,
        syntax.Flag("yes", "do not ask before sending and rebooting"),
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details="Nothing is downloaded. The device reboots; devices and links that depend on it are down meanwhile.",
    changes=True,
    again="run the same command again: it checks the device's version and continues from there",
)


def run_upgrade(arguments: syntax.Arguments) -> ExitCode:
    """Run `device upgrade`: read the files and the device, show, ask for consent, send, reboot, verify."""
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
        ) as site_session,
        progress(quiet=site_session.as_json) as notify,
    ):
        (host,) = site_session.hosts
        looking = site_session.confirm_cost(site_session.request(Mode.PLAN))
        request = site_session.request(Mode.APPLY)
        files = [Path(name) for name in arguments.many("packages")]
        preparation = PreparedUpgrade.of(
            site_session.inventory,
            host,
            files,
            looking,
            notify,
            give_up=arguments.many("drop"),
            # An emulated router is back within seconds, however far away its link is.
            waiting=WaitingUpgrade(poll_s=1.0, connect_s=10.0) if site_session.is_rehearsal else WaitingUpgrade(),
        )
        if not preparation.upgrade.send:
            return _print_result(site_session, preparation.unchanged_result())
        _show(site_session, preparation)
        preparation.affordable(request)
        if arguments.flag("plan"):
            return _print_result(site_session, preparation.plan_result())
        accepted_request = _ask(site_session, preparation, request)
        return _print_result(site_session, preparation.carry_out(site_session.inventory, accepted_request))


def _show(session: CommandSession, preparation: PreparedUpgrade) -> None:
    """Print what would be sent, its cost, and the changes that come with it."""
    from atlantis_netcfg.core import printable

    if session.as_json:
        return
    current, upgrade = preparation.observation.software, preparation.upgrade
    print(
        translate(
            f"{arg(preparation.job.name)}: {arg(printable.line(current.board))}, RouterOS {arg(current.version)} -> "
            f"{arg(upgrade.version)}"
        )
    )
    for package in upgrade.send:
        print(
            translate(
                f"  send {arg(package.path.name):<34} {arg(package.size / 1e6):6.1f} MB   SHA-256 "
                f"{arg(package.sha256[:16])}…"
            )
        )
    dear = ", which is metered" if preparation.link.is_metered else ""
    cost = msg(
        f"{arg(upgrade.size / 1e6):.1f} MB over {arg(preparation.link.name)}{arg(dear)}: about "
        f"{arg(preparation.seconds):.0f} s"
    )
    print(translate(f"  {arg(cost)}; then a reboot"))
    if preparation.link.is_metered:
        print(translate(f"  {arg(preparation.cost.words)}"))
    for note in upgrade.notes:
        print(translate(f"  note: {arg(note)}"))


def _ask(session: CommandSession, preparation: PreparedUpgrade, request: Request) -> Request:
    """Ask for consent to the cost, then to the reboot; return the request with the first consent."""
    from atlantis_netcfg.cli.base.consent import confirm_cost, require_agreement

    if session.rehearsal is not None:
        return request
    if preparation.link.is_metered and not request.accept_cost:
        confirm_cost([preparation.cost.words], ask=not session.as_json)
        request = request.model_copy(update={"accept_cost": True})
    if not session.arguments.flag("yes"):
        require_agreement(
            msg(f"Send {arg(preparation.upgrade.size / 1e6):.1f} MB and reboot {arg(preparation.job.name)} now?")
        )
    return request


def _print_result(session: CommandSession, result: UpgradeResult) -> ExitCode:
    from atlantis_netcfg.core import printable

    if session.as_json:
        print(json_text(result.as_json()))
        return result.exit
    print(f"  {result.device:<18} {printable.below(translate(result.message), 21)}")
    for line in filter(None, (result.hint, *(msg(f"note: {arg(note)}") for note in result.notes))):
        print(f"  {'':<18} {printable.below(translate(line), 21)}")
    if result.run:
        print(translate(f"  recorded as {arg(result.run)}"))
    return result.exit
