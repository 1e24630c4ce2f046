"""One run at a time on a computer: the next one is told who is at work."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
from typing import TYPE_CHECKING

from .origin import client
from .refused import Refused, in_words

if TYPE_CHECKING:
    from typing import Iterator, Mapping

    from .tree import Tree

__all__ = ["FILE", "alone"]

FILE = "/run/lock/atlantis-configure"


@contextlib.contextmanager
def alone(tree: Tree, environment: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Hold the lock of the computer, which the kernel lets go with the process, however it ends."""
    try:
        Path(tree.at(FILE)).parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(tree.at(FILE), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise in_words(error, FILE) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(handle, 200, 0).decode(errors="replace").strip()
            raise Refused(
                f"another run is at work on this computer: {holder or 'it has not text its name yet'}",
                "let it come to its end, and type the same again; a run whose link broke goes on for a while",
            ) from None
        result = client(environment)
        text = f"process {os.getpid()}" + (f", begun from {result.address}" if result is not None else "")
        os.ftruncate(handle, 0)
        os.pwrite(handle, text.encode(), 0)
        yield
    finally:
        os.close(handle)
