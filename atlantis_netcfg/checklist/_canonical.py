"""JSON of which every byte counts: one form to be signed, one to be read, and a reader that takes no other."""

from __future__ import annotations

import errno
import json
import os
from typing import TYPE_CHECKING, Any, NoReturn

from atlantis_netcfg.core.printable import lines

if TYPE_CHECKING:
    from pathlib import Path


def content(path: Path) -> bytes:
    """The bytes of a file. Raises OSError; a pipe in a file's place is an error too, and does not keep us waiting."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path))
    return path.read_bytes()


def canonical(data: object) -> bytes:
    """The form that is hashed and signed: sorted keys, no blanks, UTF-8."""
    return json.dumps(data, ensure_ascii=False, allow_nan=False, sort_keys=True, separators=(",", ":")).encode(
        errors="replace"
    )


def written(data: object) -> bytes:
    """The form in which a file is kept: whoever prints it prints no control character of a device."""
    return lines(json.dumps(data, ensure_ascii=False, allow_nan=False, indent=1)).encode() + b"\n"


def parsed(data: bytes) -> Any:  # noqa: ANN401 - what JSON holds
    """Read it. Raises ValueError for what two readers could read differently: a key twice, NaN, no UTF-8."""
    try:
        return json.loads(data.decode(), object_pairs_hook=_once, parse_constant=_refused)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key stands twice")
    return found


def _refused(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number")
