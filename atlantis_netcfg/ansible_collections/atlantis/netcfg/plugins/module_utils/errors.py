"""Error for a technician: what is wrong, and what to type next."""

from __future__ import annotations

import contextlib
import errno
import shutil
from pathlib import Path

from atlantis_netcfg.core.messages import arg, msg

_SPACE = (errno.ENOSPC, errno.EDQUOT)


class ModuleError(Exception):
    """The computer could not be brought to the desired state; `hint` is what to do about it. Both are messages."""

    def __init__(self, message: str, hint: str = "") -> None:
        self.message, self.hint = msg(message), msg(hint)
        super().__init__(self.message)


def as_module_error(error: OSError, path: str) -> ModuleError:
    """Translate an error of the operating system at `path` into a ModuleError for a person."""
    if error.errno in _SPACE:
        return ModuleError(
            f"the file system of {arg(path)} is full{arg(_describe_free_space(path))}",
            "`df -h; df -i` shows where; `apt-get clean` and `journalctl --vacuum-size=50M` free space",
        )
    if error.errno == errno.EROFS:
        return ModuleError(
            f"the file system of {arg(path)} is read-only",
            "`dmesg | tail -n 30` shows whether the card is failing; a reboot may help for a while",
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return ModuleError(
            f"cannot change {arg(path)}: {arg(error.strerror)}",
            "the toolkit needs root: allow the account to use sudo; `lsattr` shows whether the file is immutable",
        )
    if error.errno == errno.EIO:
        return ModuleError(
            f"{arg(path)}: the card reports read or write errors", "replace the card; `dmesg` shows the details"
        )
    return ModuleError(f"{arg(path)}: {arg(error.strerror or error)}", "")


def _describe_free_space(path: str) -> str:
    for place in (Path(path), *Path(path).parents):
        with contextlib.suppress(OSError):
            return msg(f": {arg(shutil.disk_usage(place).free // 1024)} kB are free")
    return ""
