"""Shared by the `provision vpn` commands: authority, inventory, operator, and output of a result."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.core.errors import ExitCode, NetcfgError
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.vpn.server import Server
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.members import OperatorContext


__all__ = [
    "AGAIN",
    "AUTHORITY",
    "CLOCK",
    "NO_PUSH",
    "folder",
    "load_inventory",
    "open_authority",
    "operator",
    "request",
    "server",
    "site",
    "table",
    "tell",
    "waiting",
    "who",
]


AUTHORITY = syntax.Word("authority", "authority folder (default: `vpn` in the state folder)")
CLOCK = syntax.Word(
    "clock",
    "`right`: this clock is right, the record is wrong",
    choices=("right",),
)
AGAIN = "recorded changes remain: run the same command again, or check with `provision vpn status`"
"""Hint after Ctrl-C."""
NO_PUSH = syntax.Flag("no-push", "only record; deploy later with `provision vpn sync`")


def folder(arguments: syntax.Arguments) -> Path:
    """Return the folder of the authority, even if it does not exist."""
    from pathlib import Path

    from atlantis_netcfg.core import paths

    authority_name = arguments.optional(AUTHORITY.name)
    return Path(authority_name).absolute() if authority_name is not None else paths.state_dir() / "vpn"


def open_authority(arguments: syntax.Arguments) -> Authority:
    """Open the authority. Raises NoAuthority."""
    from atlantis_netcfg.vpn.authority.authority import Authority

    return Authority.open(folder(arguments))


def load_inventory(arguments: syntax.Arguments) -> Inventory:
    """Load and validate the whole inventory; vaulted values stay encrypted."""
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import load

    return load(paths.inventory_folder(arguments.optional(syntax.INVENTORY.name)))


def who() -> str:
    """Return account and computer, as recorded for each action."""
    import os
    import pwd
    import socket

    try:
        account = pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        account = str(os.getuid())
    person = os.environ.get("SUDO_USER", "")
    name = msg(f"{arg(person)} as {arg(account)}") if person.isalnum() and account == "root" else account
    return f"{name}@{socket.gethostname()}"


def operator(arguments: syntax.Arguments, authority: Authority) -> OperatorContext:
    """Return the context of a signing command: authority, user, messages and clock."""
    from atlantis_netcfg.vpn.members import OperatorContext

    return OperatorContext(authority, who(), waiting(arguments), trust_clock=arguments.optional(CLOCK.name) is not None)


def waiting(arguments: syntax.Arguments) -> Callable[[str], None]:
    """Return a function that prints a message while another process holds the authority's lock."""

    def tell_person(words: str) -> None:
        if not arguments.flag(syntax.JSON.name):
            print(translate(words), file=sys.stderr, flush=True)

    return tell_person


def tell(
    arguments: syntax.Arguments,
    code: ExitCode,
    values: Mapping[str, Any],
    lines: Iterable[str],
    errors: Sequence[NetcfgError] = (),
) -> ExitCode:
    """Print the result: one JSON object, or lines on the output and errors in the usual format."""
    from atlantis_netcfg.cli.base import output

    words = output.carried_words(arguments)
    for error in errors:
        error.hint = error.hint and output.as_typed(error.hint, words)
    if arguments.flag(syntax.JSON.name):
        rows = [{"message": str(error), "hint": error.hint} for error in errors]
        print(json_text({"exit": int(code), "errors": rows, **values}))
        return code
    for line in lines:
        print(printable.line(translate(output.as_typed(line, words))))
    sys.stdout.flush()
    output.tell(errors)
    return code


def table(rows: Sequence[Sequence[str]]) -> list[str]:
    """Format rows as aligned columns; the last column has its own width."""
    widths = [max(len(row[place]) for row in rows) for place in range(len(rows[0]) - 1)] if rows else []
    return [_table_row(row, widths) for row in rows]


def _table_row(row: Sequence[str], widths: Sequence[int]) -> str:
    return join("", (*(msg(f"{arg(cell):<{width + 2}}") for cell, width in zip(row, widths, strict=False)), row[-1]))


def server(arguments: syntax.Arguments, inventory: Inventory) -> Server:
    """Return the server; with `--no-push` one that is not contacted. Raises UsageError for example values."""
    from atlantis_netcfg.operations.vpn.server import NoPush, RemoteServer, over_ssh

    if arguments.has_flag(NO_PUSH):
        return NoPush()
    otherwise = ", or add --no-push, which contacts no server" if arguments.command.flag(NO_PUSH.name) else ""
    return RemoteServer(inventory, over_ssh(inventory, request(arguments), otherwise), who())


def site(inventory: Inventory) -> str:
    """Return the site of the VPN server."""
    return inventory.hosts[inventory.pilot.vpn.server].site


def request(arguments: syntax.Arguments) -> Request:
    """Return the engine's request, with the authority's folder."""
    import shlex

    from atlantis_netcfg.operations.common.request import Request

    return Request(authority=folder(arguments), command=shlex.join(["provision", *sys.argv[1:]]))
