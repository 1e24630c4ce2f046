"""`provision report list`: the history of a site's checklists, and what has changed since all was green."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli._arguments import JSON, Command, Flag, Word

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist import Kept
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "report list",
    "list the checklists of a site, who signed them, and what has changed since the last green one",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("vehicle", "only what was found of this vehicle", example="sparus"),
    ),
    flags=(Flag("rehearsed", "those of rehearsals instead of real ones"), JSON),
)


def run(arguments: Arguments) -> ExitCode:
    """List checklists, oldest first, then what has changed since the last one that passed."""
    import json

    from atlantis_netcfg.cli._checking import kept
    from atlantis_netcfg.core.errors import ExitCode, NothingMatched

    site, vehicle, rehearsed = arguments.word("site"), arguments.optional("vehicle"), arguments.flag("rehearsed")
    every = kept.kept_of(kept.store(rehearsed=rehearsed), site, rehearsed=rehearsed)
    rows = [row for item in every if (row := _row(item, vehicle)) is not None]
    if not rows:
        raise NothingMatched(f"no checklist of `{site}` has looked at `{vehicle}`", hint="leave out `vehicle=`")
    since = _since(every, vehicle)
    if arguments.flag("json"):
        values = {"exit": int(ExitCode.DONE), "errors": [], "site": site, "checklists": rows, "since_green": since}
        print(json.dumps(values, ensure_ascii=False))
    else:
        print("\n".join([*map(_line, rows), *_changes(since)]))
    return ExitCode.DONE


def _row(entry: Kept, vehicle: str | None) -> dict[str, Any] | None:
    """None: nothing of the vehicle is in it."""
    from atlantis_netcfg.checklist import narrowed

    document = entry.document
    if document is None:
        return {"run": entry.run, "state": str(entry.state), "why": entry.why}
    seen = narrowed(document, {"vehicle": (vehicle,)}) if vehicle is not None else document
    if not seen.items:
        return None
    signed = document.signed
    return {
        "run": entry.run,
        "state": str(entry.state),
        "why": entry.why,
        "exit": int(seen.exit),
        "verdict": str(seen.verdict),
        "items": len(seen.items),
        "open": sum(item.open and item.override is None for item in seen.items),
        "overridden": sum(item.override is not None for item in seen.items),
        "scope": {name: list(chosen) for name, chosen in document.scope.items()},
        "signed_by": signed.by if signed is not None else None,
        "signed_at": signed.at.isoformat() if signed is not None else None,
        "folder": str(entry.folder),
    }


def _since(every: tuple[Kept, ...], vehicle: str | None) -> dict[str, Any] | None:
    """What is otherwise in the newest readable one than in the last green one before it."""
    from atlantis_netcfg.checklist import last_green, narrowed, since

    readable = [item for item in every if item.document is not None]
    if not readable or readable[-1].document is None:
        return None
    newest = readable[-1].document
    scope = {**newest.scope, **({"vehicle": (vehicle,)} if vehicle is not None else {})}
    green = last_green(readable[-1].folder.parent, scope, but=readable[-1].run)
    found = since(green, narrowed(newest, scope).model_copy(update={"scope": scope}))
    return found.model_dump(mode="json") if found is not None else None


def _line(row: Mapping[str, Any]) -> str:
    from atlantis_netcfg.core import printable

    if "exit" not in row:
        return printable.line(f"{row['run']}  {row['state']}: {row['why']}")
    scope = "".join(f"  {name}={','.join(chosen)}" for name, chosen in row["scope"].items())
    return printable.line(f"{row['run']}  {_green(row)}, {_standing(row)}{scope}")


def _green(row: Mapping[str, Any]) -> str:
    overridden = f", {row['overridden']} overridden" if row["overridden"] else ""
    return f"{'passed' if row['exit'] == 0 else 'not passed'} ({row['verdict']}, {row['items']} items{overridden})"


def _standing(row: Mapping[str, Any]) -> str:
    if row["state"] == "signed":
        return f"signed by {row['signed_by']}"
    waiting = f", {row['open']} items open" if row["open"] else ""
    why = f": {row['why']}" if row["why"] else ""
    return f"{row['state']}{waiting}{why}, not signed"


def _changes(since: Mapping[str, Any] | None) -> Iterator[str]:
    from atlantis_netcfg.core import printable

    if since is None:
        yield "there was no green one before the newest"
        return
    yield f"since {since['run']}, which was green:{'' if since['changes'] else ' nothing has changed'}"
    for item in since["changes"]:
        yield printable.line(
            f"  {item['id']}: {item['before'] or 'none'} -> {item['after'] or 'none'}: {item['message']}"
        )
