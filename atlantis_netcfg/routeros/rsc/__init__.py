"""The grammar of RouterOS export text (`.rsc`), used for device exports, templates and plans.

`parse` reads the output of `export` of RouterOS 6 and 7 (compact, verbose, terse; LF or CRLF) into statements.
`print_export` writes them back with the device's line wrapping, `quote` and `unquote` handle one value, `in_quotes`
always quotes. The scripting language (`:if`, `{ }`) is not parsed.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.rsc._model import Export, RscError, Statement
from atlantis_netcfg.routeros.rsc._parse import parse
from atlantis_netcfg.routeros.rsc._print import (
    WIDTH,
    console_path,
    in_quotes,
    print_export,
    print_statement,
    quote,
    unquote,
)

__all__ = [
    "WIDTH",
    "Export",
    "RscError",
    "Statement",
    "console_path",
    "in_quotes",
    "parse",
    "print_export",
    "print_statement",
    "quote",
    "unquote",
]
