"""`provision report as-built`: a stored record of each device's reported state, for comparison and printing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord

ASBUILT = syntax.CommandSpec(
    "report as-built",
    "record serial numbers, firmware and state of every device",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.DEVICES,
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("labels", "also make a sheet of QR code labels for devices and ports"),
        syntax.Flag("rehearse", "use emulated devices of the site, configured first"),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Nothing is changed. The record is saved as a page, PDF and JSON in the state folder. Exit code 0: every "
        "readable device was read, 6: a device did not respond or was read only in part, 7: no device was contacted."
    ),
)


def run_asbuilt(arguments: syntax.Arguments) -> ExitCode:
    """Run `report as-built`: read all devices at once, store the record, report."""
    import sys

    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core import printable
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.records.asbuilt.pages import rows

    _refuse_all(arguments.word("site"))
    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional("via"),
        choose_hosts=lambda inventory: choose(inventory, arguments.word("site"), arguments.many("device")),
    ) as site_session:
        if site_session.rehearsal is not None and any(
            host.name in site_session.rehearsal.targets for host in site_session.hosts
        ):
            site_session.configure_emulators()
        record, folder, digest = _make_record(site_session)
    if site_session.as_json:
        print(json_text({**record.as_json(), "kept": str(folder), "digest": digest}))
    else:
        printable.show(rows(record, str(folder)), sys.stdout)
    return record.exit


def _refuse_all(site: str) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory import ALL

    if site == ALL:
        raise UsageError("`provision report as-built` takes one site at a time", hint="type its name: `site=coastal`")


def _make_record(session: CommandSession) -> tuple[AsBuiltRecord, Path, str]:
    """Return the record, its folder, and the SHA-256 of its `as-built.json`. Raises NetcfgError."""
    import hashlib

    from atlantis_netcfg.records.asbuilt.archive import FILE, folder_of, keep, latest, new_folder, record_json
    from atlantis_netcfg.records.asbuilt.pages import html
    from atlantis_netcfg.records.asbuilt.pdf import labels_pdf, pdf
    from atlantis_netcfg.records.asbuilt.record import compare
    from atlantis_netcfg.runs import utc_now

    records_folder = folder_of(session.store, session.site)
    before = latest(records_folder)
    looked_at = _read(session)
    folder = new_folder(records_folder, utc_now())
    record = compare(looked_at.model_copy(update={"id": folder.name}), before)
    data = record_json(record)
    digest = hashlib.sha256(data).hexdigest()
    files = {FILE: data, "as-built.html": html(record, digest), "as-built.pdf": pdf(record, digest)}
    if session.arguments.flag("labels"):
        place = folder.relative_to(session.state).as_posix()
        files["labels.pdf"] = labels_pdf(record, digest, place, session.inventory.pilot.asbuilt)
    keep(folder, files)
    return record, folder, digest


def _read(session: CommandSession) -> AsBuiltRecord:
    """Read the devices, after consent to the cost."""
    import asyncio

    from atlantis_netcfg import __version__
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.records.asbuilt.collect import SiteLook, look_at
    from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord
    from atlantis_netcfg.runs import utc_now

    inventory = session.inventory
    refuse_examples(inventory, is_rehearsal=session.is_rehearsal)
    request = session.confirm_cost(session.request(Mode.DRIFT))
    with progress(quiet=session.as_json) as notify:
        site = SiteLook(inventory, session.site, request, notify, session.left_out)
        devices, costs = asyncio.run(look_at(site, session.hosts))
    return AsBuiltRecord(
        id="",
        site=session.site,
        title=inventory.sites[session.site].title,
        at=utc_now(),
        tool=__version__,
        inventory=inventory.revision,
        rehearsed=session.is_rehearsal,
        time_zone=inventory.pilot.time_zone,
        mask=inventory.pilot.asbuilt.mask,
        checklist=site.checklist,
        devices=devices,
        not_rehearsed=session.rehearsal.not_rehearsed if session.rehearsal is not None else (),
        spent=site.usage,
        costs=costs,
    )
