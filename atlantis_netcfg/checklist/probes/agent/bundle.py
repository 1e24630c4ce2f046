"""The program as one piece of bytes: sources without their docstrings, and the questions, packed together."""

from __future__ import annotations

import ast
import functools
import json
import zlib
from importlib import resources
from typing import Any

__all__ = ["BOOT", "MODULES", "program"]

BOOT = "import sys,zlib;exec(zlib.decompress(sys.stdin.buffer.read()))"
"""What `python3 -I -c` gets; the rest comes by its standard input."""
MODULES = ("_shared", "_streams", "_datagrams", "_serial", "_programs", "_dhcp", "_rtps", "main")
"""In the order in which they import each other."""
_PACKAGE = "atlantis_netcfg.checklist.probes.agent"
_LOADER = """
import json,sys,types
for name,text in {sources!r}:
 made=sys.modules[name]=types.ModuleType(name)
 exec(compile(text,name,"exec"),made.__dict__)
made.main(json.loads({asked!r}))
"""


def program(requested: dict[str, Any]) -> bytes:
    """Pack the program with what it is asked (`Batch.asked`)."""
    words = json.dumps(requested, separators=(",", ":"))
    return zlib.compress(_LOADER.format(sources=_sources(), asked=words).encode(), 9)


@functools.lru_cache(maxsize=1)
def _sources() -> tuple[tuple[str, str], ...]:
    here = resources.files(_PACKAGE)
    texts = ((name, (here / f"{name}.py").read_text(encoding="utf-8")) for name in MODULES)
    return tuple((f"{_PACKAGE}.{name}", _bare(text)) for name, text in texts)


def _bare(source: str) -> str:
    """Take out what only people read; every line keeps its number, so that a traceback fits the file."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant) or node.end_lineno is None:
            continue
        first, last = node.lineno - 1, node.end_lineno
        # Something has to stand where a docstring was all there is.
        lines[first:last] = [" " * node.col_offset + '""', *[""] * (last - first - 1)]
    return "\n".join(line.rstrip() for line in lines)
