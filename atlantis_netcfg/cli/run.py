"""`provision site=coastal`: plan, ask, change, verify."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    ONLY,
    REMOVE_FOREIGN,
    STREAM,
    UNPROTECTED,
    VERBOSE,
    VIA,
    Command,
    Flag,
    Word,
)

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "run",
    "bring a site to its declared state, guarded, and read back what came of it",
    words=(
        Word("site", "the site, or `all`", required=True, example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "show what would change and what it costs, change nothing", harmless=True),
        Flag("rehearse", "the same run against emulated devices of the site", harmless=True),
        Flag("offline", "gateways take packages and sources from this bundle alone", takes="BUNDLE"),
        Flag("yes", "do not ask before changing devices"),
        ACCEPT_COST,
        UNPROTECTED,
        REMOVE_FOREIGN,
        ASK_VAULT_PASS,
        JSON,
        STREAM,
        VERBOSE,
    ),
    changes=True,
    plays=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Plan, ask, apply, read back."""
    from atlantis_netcfg.cli._session import session

    bundle = _bundle(arguments)
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as opened:
        opened.offline = bundle
        if arguments.flag("plan"):
            report = opened.plan()
        elif opened.rehearsal is not None:
            from atlantis_netcfg.cli._rehearse import rehearse

            report = rehearse(opened, opened.rehearsal)
        else:
            report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)


def _bundle(arguments: Arguments) -> Path | None:
    """The bundle that was named. Raises UsageError where it cannot be used."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError

    named = arguments.value("offline")
    if named is not None and arguments.flag("rehearse"):
        raise UsageError(
            "`--offline` with `--rehearse`: the gateways of a rehearsal are not the systems that a bundle is made for",
            hint="leave one of them out; `--plan` shows what would be taken from the bundle",
        )
    return Path(named).absolute() if named is not None else None
