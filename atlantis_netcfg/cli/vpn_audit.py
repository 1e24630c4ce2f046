"""`provision vpn audit`: who did what, when; and whether the record is whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.errors import ExitCode

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "vpn audit",
    "tell who did what with the VPN's members, and whether the record is whole",
    words=(
        Word("since", "only from this day on, or of so many days or weeks", example="2026-11-01"),
        Word("partner", "only what concerns the devices of this partner", example="iqua"),
        AUTHORITY,
    ),
    flags=(JSON,),
    details="Exit code 6 says that the record has been changed by something else than provision, or is damaged.",
)


def run(arguments: Arguments) -> ExitCode:
    """Tell the entries, oldest first."""
    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.errors import ExitCode
    from atlantis_netcfg.operations.vpn.audit import audited, first_moment

    since = arguments.optional("since")
    start = first_moment(since) if since is not None else None
    found = audited(_vpn.opened(arguments), start, arguments.optional("partner"))
    rows = [(f"{one.at:%Y-%m-%d %H:%M:%S}", one.who, one.words) for one in found.entries]
    told = {"whole": not found.broken, "entries": [one.facts() for one in found.entries]}
    lines = [*_vpn.table(rows), *([] if found.broken else [f"{found.total} entries in all; the record is whole"])]
    return _vpn.tell(
        arguments, ExitCode.CHECKS_FAILED if found.broken else ExitCode.DONE, told, lines, errors=found.broken
    )
