"""`provision drift`: what differs from the declaration, who owns it, and since when."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, ONLY, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.journal import Run
    from atlantis_netcfg.report.drift import DriftReport

COMMAND = Command(
    "drift",
    "say what differs from the declaration, who owns it and since when, changing nothing",
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
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details="Exit code 6 says that something differs, 0 that nothing does, 4 that a device could not be read.",
)


def run(arguments: Arguments) -> ExitCode:
    """Read every device, compare, report."""
    import json

    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.declaration import ALL
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.report.junit import junit

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
    print(json.dumps(report.as_json(), ensure_ascii=False) if opened.as_json else report.as_text().rstrip())
    return report.exit


def _report(opened: Session, devices: Mapping[str, Mapping[str, Any]]) -> DriftReport:
    from atlantis_netcfg.report.drift import DriftReport

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
    )


def _unfinished(opened: Session) -> dict[str, Run]:
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
    import os

    from atlantis_netcfg.core.errors import UsageError

    scratch = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        scratch.write_bytes(data)
        scratch.replace(path)
    except OSError as error:
        scratch.unlink(missing_ok=True)
        reason = error.strerror or str(error)
        raise UsageError(f"{path} cannot be written: {reason}", hint="name another file with `--junit`") from error
