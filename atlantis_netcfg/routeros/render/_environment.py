"""Our Jinja environment: undefined names are errors, and filters write values in RouterOS syntax."""

from __future__ import annotations

import hashlib
import inspect
import re
import time
from contextlib import suppress
from datetime import timedelta
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined

from atlantis_netcfg.core import paths
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from jinja2.bccache import Bucket

    from atlantis_netcfg.core.secret import Secret

MARK = "atlantis: "
"""Start of the comment of every row that is ours."""

_KEPT_S = 30 * 24 * 3600
"""Time for which a compiled template is kept."""
_UNITS = (("w", 7 * 24 * 3600), ("d", 24 * 3600), ("h", 3600), ("m", 60), ("s", 1))


def template_folder() -> Path:
    """Return the folder of the shipped templates."""
    return paths.resource("templates")


def environment(templates: Path | None = None) -> Environment:
    """Return the environment, which caches compiled templates; `templates` overrides the search path."""
    return _build_environment(templates or template_folder())


class _TemplateCache(FileSystemBytecodeCache):
    """Compiled templates of earlier starts; a file that cannot be read or written is ignored."""

    def __init__(self, folder: Path, depends: bytes) -> None:
        super().__init__(str(folder), "%s")
        self._depends = depends

    def get_source_checksum(self, source: str) -> str:
        """Return a checksum of everything that the compiled code depends on."""
        return hashlib.sha256(self._depends + source.encode()).hexdigest()

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load compiled code from its file."""
        try:
            super().load_bytecode(bucket)
        except Exception:  # noqa: BLE001 - reading a damaged file may raise anything
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Write compiled code atomically; remove old files, whose checkout may no longer exist."""
        with suppress(OSError):
            super().dump_bytecode(bucket)
        oldest = time.time() - _KEPT_S
        for file in Path(self.directory).glob("*"):
            with suppress(OSError):
                if file.stat().st_mtime < oldest:
                    file.unlink()


def get_template_cache(*modules: str) -> FileSystemBytecodeCache | None:
    """Return the cache of compiled templates; None if others could write to its folder.

    Jinja evaluates constant expressions at compile time, filters included: `modules` are the files that define
    environment and filters.
    """
    folder = paths.private_cache("templates")
    if folder is None:
        return None
    sources = [version("jinja2").encode(), *(Path(module).read_bytes() for module in modules)]
    return _TemplateCache(folder, hashlib.sha256(b"\0".join(sources)).digest())


@cache
def _build_environment(folder: Path) -> Environment:
    result = Environment(
        loader=FileSystemLoader(folder),
        bytecode_cache=get_template_cache(__file__, inspect.getfile(quote)),
        undefined=StrictUndefined,
        autoescape=False,  # noqa: S701 - router text, not HTML: `&` must stay `&`; the filter `quote` does RouterOS' escaping
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    result.filters.update(
        quote=_quote, mark=mark, duration=duration, reveal=_reveal, yesno=_yesno, nft_comment=nft_comment, value=_value
    )
    return result


def mark(what: str) -> str:
    """Return the comment that marks a row as ours and gives its purpose."""
    return quote(MARK + what)


def _value(text: str) -> str:
    """Return a value of a note as `desired.read` knows it."""
    return f"{{{text}}}"


def nft_comment(text: str) -> str:
    """Return an nftables comment (at most 128 bytes): characters that could end the string are replaced."""
    return 'comment "' + re.sub(r"[^A-Za-z0-9 ,.:?-]", "_", text)[:60] + '"'


def duration(seconds: float) -> str:
    """Format a duration as RouterOS does: `1h30m`, `1d`, `500ms`."""
    milliseconds = round(timedelta(seconds=seconds) / timedelta(milliseconds=1))
    remaining, below = divmod(milliseconds, 1000)
    text = ""
    for unit, size in _UNITS:
        count, remaining = divmod(remaining, size)
        text += f"{count}{unit}" if count else ""
    return text + (f"{below}ms" if below else "") or "0s"


def _quote(value: object) -> str:
    return quote(str(value))


def _reveal(secret: Secret) -> str:
    return secret.reveal()


def _yesno(value: bool) -> str:  # noqa: FBT001 - a filter's value
    return "yes" if value else "no"
