"""`provision asbuilt`: what each device of a site says of itself, as a record that is kept, compared and printed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    ONLY,
    PROFILE,
    VIA,
    Arguments,
    CommandSpec,
    Flag,
    Group,
    Word,
)
from atlantis_netcfg.cli.base.output import json_text

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord

ASBUILT = CommandSpec(
    "asbuilt",
    "write down what each device of a site says of itself, and what is different",
    group=Group.DEVICE,
    words=(
        Word("site", "the site", required=True, example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("labels", "also a sheet of labels with QR codes, one for each device and each port"),
        Flag("rehearse", "the same with emulated devices of the site, configured first"),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Nothing is changed. The record is kept as page, PDF and JSON below the state folder. Exit code 0: every "
        "device that can be asked was read, 6: one did not answer, or not whole, 7: nobody was asked."
    ),
)


def run_asbuilt(arguments: Arguments) -> ExitCode:
    """Ask every device at once, keep the record, tell."""
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
        chosen=lambda declaration: choose(declaration, arguments.word("site"), arguments.many("only")),
    ) as opened:
        if opened.rehearsal is not None and any(host.name in opened.rehearsal.targets for host in opened.hosts):
            opened.configure_twins()
        record, folder, digest = _made(opened)
    if opened.as_json:
        print(json_text({**record.as_json(), "kept": str(folder), "digest": digest}))
    else:
        printable.show(rows(record, str(folder)), sys.stdout)
    return record.exit


def _refuse_all(site: str) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory import ALL

    if site == ALL:
        raise UsageError("`provision asbuilt` is about one site at a time", hint="type its name: `site=coastal`")


def _made(opened: CommandSession) -> tuple[AsBuiltRecord, Path, str]:
    """The record, the folder in which it is kept, and the SHA-256 of its `as-built.json`. Raises NetcfgError."""
    import hashlib
    import json

    from atlantis_netcfg.records.asbuilt.archive import FILE, folder_of, keep, latest, new_folder
    from atlantis_netcfg.records.asbuilt.pages import html
    from atlantis_netcfg.records.asbuilt.pdf import labels_pdf, pdf
    from atlantis_netcfg.records.asbuilt.record import compared
    from atlantis_netcfg.runs import utc_now

    kept = folder_of(opened.store, opened.site)
    before = latest(kept)
    looked_at = _read(opened)
    folder = new_folder(kept, utc_now())
    record = compared(looked_at.model_copy(update={"id": folder.name}), before)
    data = json.dumps(record.as_json(), ensure_ascii=False, indent=1).encode()
    digest = hashlib.sha256(data).hexdigest()
    files = {FILE: data, "as-built.html": html(record, digest), "as-built.pdf": pdf(record, digest)}
    if opened.arguments.flag("labels"):
        place = folder.relative_to(opened.state).as_posix()
        files["labels.pdf"] = labels_pdf(record, digest, place, opened.declaration.pilot.asbuilt)
    keep(folder, files)
    return record, folder, digest


def _read(opened: CommandSession) -> AsBuiltRecord:
    """Ask, once it is agreed what the asking may cost."""
    import asyncio

    from atlantis_netcfg import __version__
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.records.asbuilt.collect import SiteLook, look_at
    from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord
    from atlantis_netcfg.runs import utc_now

    declaration = opened.declaration
    refuse_examples(declaration, rehearsed=opened.rehearsed)
    request = opened.paid(opened.request(Mode.DRIFT))
    with progress(quiet=opened.as_json) as notify:
        site = SiteLook(declaration, opened.site, request, notify, opened.left_out)
        devices, costs = asyncio.run(look_at(site, opened.hosts))
    return AsBuiltRecord(
        id="",
        site=opened.site,
        title=declaration.sites[opened.site].title,
        at=utc_now(),
        tool=__version__,
        inventory=declaration.revision,
        rehearsed=opened.rehearsed,
        time_zone=declaration.pilot.time_zone,
        mask=declaration.pilot.asbuilt.mask,
        checklist=site.checklist,
        devices=devices,
        not_rehearsed=opened.rehearsal.not_rehearsed if opened.rehearsal is not None else (),
        spent=site.spent,
        costs=costs,
    )
