"""Our Jinja environment: undefined names are errors, and filters write values the way RouterOS reads them."""

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

from atlantis_netcfg.core.paths import checkout, private_cache
from atlantis_netcfg.routeros.rsc import quote

if TYPE_CHECKING:
    from jinja2.bccache import Bucket

    from atlantis_netcfg.core.secret import Secret

MARK = "atlantis: "
"""Opens the comment of every row that is ours."""

_PACKAGE = Path(__file__).resolve().parents[2]
_KEPT_S = 30 * 24 * 3600
"""For so long a compiled template is kept."""
_UNITS = (("w", 7 * 24 * 3600), ("d", 24 * 3600), ("h", 3600), ("m", 60), ("s", 1))


def template_folder() -> Path:
    """`templates/` of the checkout; in an installed wheel the copy inside the package."""
    beside = checkout() / "templates"
    return beside if (beside / "routeros").is_dir() else _PACKAGE / "templates"


def environment(templates: Path | None = None) -> Environment:
    """The environment, in which a template is compiled once; `templates` overrides where it looks."""
    return _build_environment(templates or template_folder())


class _TemplateCache(FileSystemBytecodeCache):
    """What earlier starts have compiled; a file that cannot be read or written is as none."""

    def __init__(self, folder: Path, depends: bytes) -> None:
        super().__init__(str(folder), "%s")
        self._depends = depends

    def get_source_checksum(self, source: str) -> str:
        """Of all that the compiled code depends on."""
        return hashlib.sha256(self._depends + source.encode()).hexdigest()

    def load_bytecode(self, bucket: Bucket) -> None:
        """Take it from its file."""
        try:
            super().load_bytecode(bucket)
        except Exception:  # noqa: BLE001 - reading a damaged file may raise anything
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Put it into its file, whole or not at all; what is old goes: the checkout that it was for may be gone."""
        with suppress(OSError):
            super().dump_bytecode(bucket)
        oldest = time.time() - _KEPT_S
        for file in Path(self.directory).glob("*"):
            with suppress(OSError):
                if file.stat().st_mtime < oldest:
                    file.unlink()


def get_template_cache(*modules: str) -> FileSystemBytecodeCache | None:
    """Keep compiled templates from one start to the next; none where nobody else could be kept from writing them.

    Jinja works out at once what it can, filters included: `modules` are the files that make the environment and them.
    """
    folder = private_cache("templates")
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
        quote=_quote, mark=mark, duration=duration, reveal=_reveal, yesno=_yesno, nft_comment=nft_comment
    )
    return result


def mark(what: str) -> str:
    """Write the comment that marks a row as ours and says what it is for."""
    return quote(MARK + what)


def nft_comment(text: str) -> str:
    """Write a comment of nftables: a name of the inventory may hold what ends a string, and 128 bytes are kept."""
    return 'comment "' + re.sub(r"[^A-Za-z0-9 ,.:?-]", "_", text)[:60] + '"'


def duration(seconds: float) -> str:
    """Write a time interval as RouterOS prints it: `1h30m`, `1d`, `500ms`."""
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
