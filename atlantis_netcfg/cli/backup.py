"""`provision backup`: keep what the devices of a site say they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, ASK_VAULT_PASS, INVENTORY, JSON, ONLY, VERBOSE, Command, Word

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "backup",
    "save the full state of a site's devices, changing nothing",
    words=(
        Word("site", "the site, or `all`", required=True, example="coastal"),
        ONLY,
        INVENTORY,
    ),
    flags=(ACCEPT_COST, ASK_VAULT_PASS, JSON, VERBOSE),
    details="The saved export hides secrets, as RouterOS does; they are not in the backup.",
)


def run(arguments: Arguments) -> ExitCode:
    """Save an export of each device under a run of its own."""
    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.operations import Mode

    with session(arguments) as opened:
        report = opened.perform(Mode.BACKUP)
    return opened.close(report)
