"""The grammar of RouterOS export text (`.rsc`): technicians read devices in it, templates declare and plans show them.

`parse` reads what `export` of RouterOS 6 and 7 prints (compact, verbose, terse; LF or CRLF) into statements,
`print_export` writes them back wrapped as the device wraps, `quote` and `unquote` do one value, `in_quotes` quotes what
would do without. The language of scripts (`:if`, `{ }`) is not read.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.rsc._model import Export, RscError, Statement
from atlantis_netcfg.routeros.rsc._parse import parse
from atlantis_netcfg.routeros.rsc._print import (
    VOLATILE_COMMENTS,
    WIDTH,
    console_path,
    drop_volatile,
    in_quotes,
    is_volatile,
    print_export,
    print_statement,
    quote,
    unquote,
)

__all__ = [
    "VOLATILE_COMMENTS",
    "WIDTH",
    "Export",
    "RscError",
    "Statement",
    "console_path",
    "drop_volatile",
    "in_quotes",
    "is_volatile",
    "parse",
    "print_export",
    "print_statement",
    "quote",
    "unquote",
]
