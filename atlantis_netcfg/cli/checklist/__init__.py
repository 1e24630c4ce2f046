"""Commands of the pre-test checklist: `check`, `report checklists`, `report show`, `report verify`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import SavedChecklist, SigningTrouble
    from atlantis_netcfg.checklist.report import Document
    from atlantis_netcfg.core.errors import ExitCode


CHECK = syntax.CommandSpec(
    "check",
    "run, confirm and sign the pre-test checklist of a site",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("vehicle", "only these vehicles", many=True, example="sparus"),
        syntax.Word(
            "endpoint",
            "only these columns of Table 3, or these other groups",
            many=True,
            choices=(
                *("wifi", "acoustic", "satellite", "usbl", "rc_rf", "4g", "gps"),
                *("ethernet", "site", "robot", "integration", "items"),
            ),
        ),
        syntax.Word(
            "phase",
            "only this phase (recovery, integration: separate lists)",
            many=True,
            choices=("bench", "quay", "in-water", "recovery", "integration"),
        ),
        syntax.Word("mission", "include the site's items for this mission", example="night"),
        syntax.Word("break", "rehearsal: simulate these faults first, for training", many=True, example="rogue-dhcp"),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("answers", "read consents and confirmations from this file, ask nobody", takes="FILE"),
        syntax.Flag("anew", "start a new checklist, do not continue the interrupted one"),
        syntax.Flag("sign-as", "sign with this name when nothing is open, without asking", takes="NAME"),
        syntax.Flag("rehearse", "use emulated vehicles and devices of the site"),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Each result and answer is saved at once; after an interruption, run the same command again to continue. "
        "Nothing is transmitted into the water and no cost arises without a person's consent. Exit code 0: every "
        "item passed or was overridden, 6: an item did not pass or is open, 7: nothing was checked."
    ),
)


def run_check(arguments: syntax.Arguments) -> ExitCode:
    """Run `check`: compute the list, open the checklist, run probes and ask the user, report."""
    from atlantis_netcfg.cli.checklist.check_run import run_check

    return run_check(arguments)


REPORT_LIST = syntax.CommandSpec(
    "report checklists",
    "list a site's checklists with signatures and changes",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("vehicle", "only results of this vehicle", example="sparus"),
    ),
    flags=(syntax.Flag("rehearse", "those of rehearsals instead of real ones"), syntax.JSON),
)


def run_report_list(arguments: syntax.Arguments) -> ExitCode:
    """List checklists, oldest first, then what has changed since the last one that passed."""
    from atlantis_netcfg.cli.checklist import check_run
    from atlantis_netcfg.core.errors import ExitCode, NoMatchError

    site, vehicle, is_rehearsal = arguments.word("site"), arguments.optional("vehicle"), arguments.flag("rehearse")
    every = check_run.kept_of(check_run.store(is_rehearsal=is_rehearsal), site, is_rehearsal=is_rehearsal)
    rows = [row for item in every if (row := _listed_row(item, vehicle)) is not None]
    if not rows:
        raise NoMatchError(f"no checklist of `{arg(site)}` includes `{arg(vehicle)}`", hint="remove `vehicle=`")
    since = _since(every, vehicle)
    if arguments.flag("json"):
        values = {"exit": int(ExitCode.DONE), "errors": [], "site": site, "checklists": rows, "since_green": since}
        print(json_text(values))
    else:
        print("\n".join([*(line for row in rows for line in _listed_lines(row)), *_change_lines(since)]))
    return ExitCode.DONE


def _listed_row(entry: SavedChecklist, vehicle: str | None) -> dict[str, Any] | None:
    """Return the row of a checklist; None if it contains nothing of the vehicle."""
    from atlantis_netcfg.checklist import filter_by_scope

    document = entry.document
    if document is None:
        return {"run": entry.run, "state": str(entry.state), "why": entry.why}
    view = filter_by_scope(document, {"vehicle": (vehicle,)}) if vehicle is not None else document
    if not view.items:
        return None
    signature = document.signed
    return {
        "run": entry.run,
        "state": str(entry.state),
        "why": entry.why,
        "exit": int(view.exit),
        "verdict": str(view.verdict),
        "items": len(view.items),
        "open": sum(item.open and item.override is None for item in view.items),
        "overridden": sum(item.override is not None for item in view.items),
        "scope": {name: list(values) for name, values in document.scope.items()},
        "mission": document.mission,
        "signed_by": signature.by if signature is not None else None,
        "signed_at": signature.at.isoformat() if signature is not None else None,
        "time_zone": document.time_zone,
        "folder": str(entry.folder),
    }


def _since(every: tuple[SavedChecklist, ...], vehicle: str | None) -> dict[str, Any] | None:
    """Return the differences between the newest readable checklist and the last green one before it."""
    from atlantis_netcfg.checklist import compare_with_green, filter_by_scope, last_green

    readable = [item for item in every if item.document is not None]
    if not readable or readable[-1].document is None:
        return None
    newest = readable[-1].document
    scope = {**newest.scope, **({"vehicle": (vehicle,)} if vehicle is not None else {})}
    green = last_green(readable[-1].folder.parent, scope, but=readable[-1].run)
    difference = compare_with_green(green, filter_by_scope(newest, scope).model_copy(update={"scope": scope}))
    return difference.model_dump(mode="json") if difference is not None else None


def _listed_lines(row: Mapping[str, Any]) -> Iterator[str]:
    from atlantis_netcfg.core import printable
    from atlantis_netcfg.core.language import translate

    if "exit" not in row:
        yield printable.line(f"{row['run']}  {row['state']}: {translate(row['why'])}")
        return
    scope = f"  mission={row['mission']}" if row["mission"] else ""
    scope += "".join(msg(f"  {arg(name)}={arg(','.join(values))}") for name, values in row["scope"].items())
    yield printable.line(f"{row['run']}  {translate(_outcome_text(row))}{scope}")
    yield printable.line(f"  {translate(_state_text(row))}")


def _outcome_text(row: Mapping[str, Any]) -> str:
    overridden = msg(f", {arg(row['overridden'])} overridden" if row["overridden"] else "")
    return msg(
        f"{'passed' if row['exit'] == 0 else 'not passed'} ({arg(row['verdict'])}, {arg(row['items'])} "
        f"items{arg(overridden)})"
    )


def _state_text(row: Mapping[str, Any]) -> str:
    from datetime import datetime

    from atlantis_netcfg.core.times import time_text

    if row["state"] == "signed":
        return msg(
            f"signed by {arg(row['signed_by'])}, "
            f"{arg(time_text(datetime.fromisoformat(row['signed_at']), row['time_zone']))}"
        )
    waiting = msg(f", {arg(row['open'])} items open" if row["open"] else "")
    why = msg(f": {arg(row['why'])}" if row["why"] else "")
    return msg(f"{arg(row['state'])}{arg(waiting)}{arg(why)}, not signed")


def _change_lines(since: Mapping[str, Any] | None) -> Iterator[str]:
    from atlantis_netcfg.core import printable
    from atlantis_netcfg.core.language import translate

    if since is None:
        yield translate("no earlier checklist passed")
        return
    no_change = msg(f"since {arg(since['run'])}, which passed: no change")
    yield translate(f"since {arg(since['run'])}, which passed:" if since["changes"] else no_change)
    for item in since["changes"]:
        before, after = (item[key] or translate("none") for key in ("before", "after"))
        yield printable.line(f"  {item['id']}: {before} -> {after}: {translate(item['message'])}")


REPORT_SHOW = syntax.CommandSpec(
    "report show",
    "show a stored checklist",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("run", "which checklist (default: the newest)", example="20260504T093000Z"),
    ),
    flags=(syntax.Flag("rehearse", "a checklist of a rehearsal, not a real one"), syntax.JSON),
    details=(
        "Exit code as for the checklist: 0: every item passed or was overridden, 6: not all, 7: nothing was checked."
    ),
)


def run_report_show(arguments: syntax.Arguments) -> ExitCode:
    """Print the same summary as at the end of a checklist."""
    import sys

    from atlantis_netcfg.checklist.report import body, ending
    from atlantis_netcfg.cli.checklist import check_run
    from atlantis_netcfg.core.errors import DeviceError
    from atlantis_netcfg.core.printable import show

    site, is_rehearsal = arguments.word("site"), arguments.flag("rehearse")
    every = check_run.kept_of(check_run.store(is_rehearsal=is_rehearsal), site, is_rehearsal=is_rehearsal)
    item = check_run.run_of(every, arguments.optional("run"))
    if item.document is None:
        raise DeviceError(
            f"cannot read the checklist {arg(item.run)}: {arg(item.why)}",
            hint="check it with `provision report verify`",
        )
    if arguments.flag("json"):
        print(json_text({**check_run.as_json(item.document), "errors": []}))
    else:
        last = [*check_run.pages_in(item.folder)]
        show([*body(item.document), "", *ending(item.document), *last], sys.stdout)
    return item.document.exit


REPORT_VERIFY = syntax.CommandSpec(
    "report verify",
    "verify the signatures of checklists and their files",
    words=(
        syntax.Word("site", "only those of this site", example="coastal"),
        syntax.Word("run", "only this checklist", example="20260504T093000Z"),
        syntax.Word("file", "a report.json received by mail, instead of the local ones", example="report.json"),
        syntax.Word(
            "key",
            "fingerprints of accepted keys (default: this computer's)",
            many=True,
            example="SHA256:…",
        ),
    ),
    flags=(syntax.JSON,),
    details=(
        "Covers real and rehearsed checklists. Exit code 0: unchanged since signing, 6: a file does not match "
        "its signature, 7: nothing was signed. Compare the fingerprint of a key with the person who signed, "
        "never with the file itself."
    ),
)


def run_report_verify(arguments: syntax.Arguments) -> ExitCode:
    """Look at every byte that was signed."""
    from atlantis_netcfg.core.errors import ExitCode, NoMatchError

    file = arguments.optional("file")
    rows = [_file_row(arguments, file)] if file is not None else list(_local_rows(arguments))
    if not rows:
        raise NoMatchError("nothing was signed", hint="`provision check site=NAME` ends with signing")
    code = ExitCode.CHECKS_FAILED if any(row["troubles"] for row in rows) else ExitCode.DONE
    if arguments.flag("json"):
        print(json_text({"exit": int(code), "errors": [], "verified": rows}))
    else:
        print(translate(join("\n", (line for row in rows for line in _lines(row)))))
    return code


def _local_rows(arguments: syntax.Arguments) -> Iterator[dict[str, Any]]:
    """Yield a row for each checklist signed here, real ones first."""
    from atlantis_netcfg.checklist import books, verify
    from atlantis_netcfg.cli.checklist import check_run
    from atlantis_netcfg.cli.checklist.check_run import folder_of

    site, name = arguments.optional("site"), arguments.optional("run")
    for where in (check_run.store(is_rehearsal=False), check_run.store(is_rehearsal=True)):
        for at in check_run.sites_with(where):
            for book in books(folder_of(where, at)) if site in {None, at} else ():
                if name in {None, book.run} and _was_signed(book):
                    troubles = verify(book.folder, required_keys=arguments.many("key"))
                    yield _verified_row(f"{at} {book.run}", book.folder, book.document, troubles)


def _was_signed(item: SavedChecklist) -> bool:
    """Return whether a checklist was signed, is damaged, or has a signed report without manifest, which comes last."""
    from atlantis_netcfg.checklist import VehicleState

    return item.state in {VehicleState.SIGNED, VehicleState.DAMAGED} or (item.folder / "report.json").exists()


def _file_row(arguments: syntax.Arguments, name: str) -> dict[str, Any]:
    """Return the row of a single report file, named by its file name."""
    from dataclasses import replace
    from pathlib import Path

    from atlantis_netcfg.checklist import KEY, verify_report
    from atlantis_netcfg.checklist.report import Document
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.core.errors import UsageError

    path = Path(name)
    try:
        data = path.read_bytes()
    except OSError as error:
        hint = "give the report.json of a checklist"
        raise UsageError(f"cannot read `{arg(name)}`: {arg(error.strerror)}", hint=hint) from error
    try:
        document = Document.model_validate_json(data)
    except ValueError:
        document = None
    troubles = verify_report(data, key=paths.state_dir() / KEY, required_keys=arguments.many("key"))
    return _verified_row(name, path, document, [replace(trouble, file=path.name) for trouble in troubles])


def _verified_row(
    name: str, place: Path, document: Document | None, troubles: Sequence[SigningTrouble]
) -> dict[str, Any]:
    signature = document.signed if document is not None else None
    return {
        "name": name,
        "place": str(place),
        "site": document.site if document is not None else None,
        "run": document.run if document is not None else None,
        "rehearsed": document.rehearsed if document is not None else None,
        "time_zone": document.time_zone if document is not None else "",
        "signed": signature.model_dump(mode="json") if signature is not None else None,
        "troubles": [{"file": trouble.file, "what": trouble.what, "hint": trouble.hint} for trouble in troubles],
    }


def _lines(row: Mapping[str, Any]) -> Iterator[str]:
    from datetime import datetime

    from atlantis_netcfg.core import printable
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.core.times import time_text

    rehearsal_note = ", rehearsed" if row["rehearsed"] else ""
    if not row["troubles"]:
        signature = row["signed"]
        at = time_text(datetime.fromisoformat(signature["at"]), row["time_zone"])
        words = msg(
            f"{arg(row['name'])}{arg(rehearsal_note)}: as signed by {arg(signature['by'])} at {arg(at)}, key "
            f"{arg(signature['key'])}"
        )
        yield printable.line(translate(words))
        return
    yield printable.line(translate(f"{arg(row['name'])}{arg(rehearsal_note)}: NOT VERIFIED ({arg(row['place'])})"))
    for item in row["troubles"]:
        yield printable.line(f"  {item['file']}: {translate(item['what'])}")
        yield printable.line(f"    -> {translate(item['hint'])}")
