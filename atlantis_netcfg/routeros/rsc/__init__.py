"""The grammar of RouterOS export text (`.rsc`), used for device exports, templates and plans.

`parse` reads the output of `export` of RouterOS 6 and 7 (compact, verbose, terse; LF or CRLF) into statements.
`print_export` writes them back with the device's line wrapping, `quote` and `unquote` handle one value, `in_quotes`
always quotes. The scripting language (`:if`, `{ }`) is not parsed.
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
