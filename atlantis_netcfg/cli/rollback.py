"""`provision rollback`: put back what a device was before a run, guarded like any other change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    ONLY,
    REMOVE_FOREIGN,
    UNPROTECTED,
    VERBOSE,
    Command,
    Flag,
    Word,
)

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "rollback",
    "put a site's devices back to what they were before a run",
    words=(
        Word("site", "the site of the run", required=True, example="coastal"),
        Word("to", "the run, as `provision runs` lists it: its saved state is put back", required=True, example="RUN"),
        ONLY,
        INVENTORY,
    ),
    flags=(
        Flag("yes", "do not ask before changing devices"),
        ACCEPT_COST,
        UNPROTECTED,
        REMOVE_FOREIGN,
        ASK_VAULT_PASS,
        JSON,
        VERBOSE,
    ),
    details="Secrets are not in the saved state: what the device holds of them stays.",
    changes=True,
    plays=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Show the way back, ask, then roll back every device of which the run has saved a state."""
    from atlantis_netcfg.cli._session import session

    with session(arguments) as opened:
        saved = opened.store.run(opened.site, arguments.word("to"))
        opened.narrow([host.name for host in opened.hosts if saved.before(host.name) is not None])
        opened.back_to = saved.id
        report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)
