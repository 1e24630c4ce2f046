"""`provision report show`: a kept checklist again, and where its pages are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "report show",
    "show a checklist that is kept, and where its pages are",
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("run", "which one; the newest if left out", example="20260504T093000Z"),
    ),
    flags=(Flag("rehearsed", "one of a rehearsal instead of a real one"), JSON),
    details="Exit code as that of the checklist: 0 all green, 6 not, 7 nothing was checked.",
)


def run(arguments: Arguments) -> ExitCode:
    """Print what its end has printed."""
    import json

    from atlantis_netcfg.checklist.report import lines
    from atlantis_netcfg.cli._checking import kept
    from atlantis_netcfg.core.errors import DeviceFailed

    site, rehearsed = arguments.word("site"), arguments.flag("rehearsed")
    every = kept.kept_of(kept.store(rehearsed=rehearsed), site, rehearsed=rehearsed)
    item = kept.run_of(every, arguments.optional("run"))
    if item.document is None:
        raise DeviceFailed(
            f"the checklist {item.run} cannot be read: {item.why}", hint="look at it with `provision report verify`"
        )
    if arguments.flag("json"):
        print(json.dumps({**kept.as_json(item.document), "errors": []}, ensure_ascii=False))
    else:
        print("\n".join([lines(item.document), *kept.pages_in(item.folder)]))
    return item.document.exit
