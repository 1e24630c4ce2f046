"""The remote tool: all remote modules in one archive of a few dozen kB, sent over a link once.

Ansible itself sends every module call as a separate program of 170 kB. The responder on the VPN server is a separate
archive of the same files, so that gateways do not download it.
"""

from __future__ import annotations

import ast
import bz2
import hashlib
import io
import re
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_PLUGINS = Path(__file__).parents[2] / "ansible_collections/atlantis/netcfg/plugins"
_BOARD = _PLUGINS / "plugin_utils" / "board"
INSTALL = _BOARD / "install.py"
"""Program that installs a tool on the gateway."""
_CORE = ("messages", "stored_messages")
"""Modules of `core` that the modules on other computers need."""
_DOCUMENTATION = frozenset({"DOCUMENTATION", "EXAMPLES", "RETURN"})
_LIVE = "vpn_"
"""Prefix of files that only the VPN server needs."""
_SERVES = "vpn_serve"
_IMPORT = re.compile(r"^ *from \.(\w*) import ([\w, ]*)", re.MULTILINE)
_BEGINNING = (1980, 1, 1, 0, 0, 0)
"""Earliest time that a zip archive can store; a fixed time makes archives of the same files identical."""


@dataclass(frozen=True)
class Tool:
    """An archive that Python can run; its files are stored uncompressed, so that it compresses well as a whole."""

    content: bytes

    @cached_property
    def sha256(self) -> str:
        """SHA-256 in hex, the tool's name on the gateways."""
        return hashlib.sha256(self.content).hexdigest()

    @cached_property
    def payload(self) -> bytes:
        """Compressed bytes for the link: bzip2 beats xz and deflate here, and every Python has it."""
        return bz2.compress(self.content)


def build(plugins: Path = _PLUGINS) -> Tool:
    """Build the tool from the current modules; takes about 20 ms."""
    return _pack(_files(plugins))


def build_live(plugins: Path = _PLUGINS) -> Tool:
    """Build the VPN server's tool: the server program and its imports."""
    return _pack(_live_files(plugins))


def _pack(files: Iterable[tuple[str, str]]) -> Tool:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name, text in sorted(files):
            entry = zipfile.ZipInfo(name, _BEGINNING)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, text)
    return Tool(buffer.getvalue())


def _files(plugins: Path) -> Iterator[tuple[str, str]]:
    yield "__main__.py", (_BOARD / "start.py").read_text(encoding="utf-8")
    yield "ansible/module_utils/basic.py", (_BOARD / "basic.py").read_text(encoding="utf-8")
    for package in ("ansible", "ansible/module_utils", "atlantis", "atlantis/modules", "atlantis/module_utils"):
        yield f"{package}/__init__.py", ""
    yield "atlantis/modules/batch.py", (_BOARD / "batch.py").read_text(encoding="utf-8")
    yield from _core_files()
    for path in plugins.glob("module_utils/*.py"):
        if not path.name.startswith(_LIVE):
            yield f"atlantis/module_utils/{path.name}", path.read_text(encoding="utf-8")
    for path in plugins.glob("modules/*.py"):
        yield f"atlantis/modules/{path.name}", _strip_documentation(path.read_text(encoding="utf-8"))


def _core_files() -> Iterator[tuple[str, str]]:
    for package in ("atlantis_netcfg", "atlantis_netcfg/core"):
        yield f"{package}/__init__.py", ""
    for name in _CORE:
        yield f"atlantis_netcfg/core/{name}.py", (Path(__file__).parents[1] / f"{name}.py").read_text(encoding="utf-8")


def _live_files(plugins: Path) -> Iterator[tuple[str, str]]:
    yield "__main__.py", (_BOARD / "live.py").read_text(encoding="utf-8")
    for package in ("atlantis", "atlantis/module_utils"):
        yield f"{package}/__init__.py", ""
    yield from _core_files()
    pending_names, read = [_SERVES], set[str]()
    while pending_names:
        if (name := pending_names.pop()) not in read:
            text = (plugins / "module_utils" / f"{name}.py").read_text(encoding="utf-8")
            yield f"atlantis/module_utils/{name}.py", text
            read.add(name)
            pending_names += _imported_names(text)


def _imported_names(text: str) -> Iterator[str]:
    """Yield sibling modules that a file imports by `from .name import …` or `from . import name, …`."""
    for module, names in _IMPORT.findall(text):
        yield from [module] if module else (name.strip() for name in names.split(","))


def _strip_documentation(text: str) -> str:
    """Remove the parts that only `ansible-doc` uses."""
    lines = text.splitlines(keepends=True)
    for statement in reversed(ast.parse(text).body):
        names = {name.id for name in getattr(statement, "targets", ()) if isinstance(name, ast.Name)}
        if names and names <= _DOCUMENTATION:
            del lines[statement.lineno - 1 : statement.end_lineno]
    return "".join(lines)
