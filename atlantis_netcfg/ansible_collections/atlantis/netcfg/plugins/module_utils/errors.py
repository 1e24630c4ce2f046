"""Error for a technician: what is wrong, and what to type next."""

from __future__ import annotations

import contextlib
import errno
import shutil
from pathlib import Path

_SPACE = (errno.ENOSPC, errno.EDQUOT)


class ModuleError(Exception):
    """The computer could not be brought to the desired state; `hint` is what to do about it."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def as_module_error(error: OSError, path: str) -> ModuleError:
    """Translate an error of the operating system at `path` into a ModuleError for a person."""
    if error.errno in _SPACE:
        return ModuleError(
            f"the file system of {path} is full{_describe_free_space(path)}",
            "`df -h; df -i` tells where; `apt-get clean` and `journalctl --vacuum-size=50M` make room",
        )
    if error.errno == errno.EROFS:
        return ModuleError(
            f"the file system of {path} can only be read",
            "`dmesg | tail -n 30` tells whether the card is failing; a reboot may bring it back for a while",
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return ModuleError(
            f"{path} may not be changed: {error.strerror}",
            "the toolkit needs root: let the account use sudo; `lsattr` tells whether somebody froze the file",
        )
    if error.errno == errno.EIO:
        return ModuleError(
            f"{path}: the card answers with read or write errors", "replace the card; `dmesg` has the details"
        )
    return ModuleError(f"{path}: {error.strerror or error}", "")


def _describe_free_space(path: str) -> str:
    for place in (Path(path), *Path(path).parents):
        with contextlib.suppress(OSError):
            return f": {shutil.disk_usage(place).free // 1024} kB are free"
    return ""
