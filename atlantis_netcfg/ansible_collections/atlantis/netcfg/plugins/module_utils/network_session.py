"""When the SSH session of this process was made."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["began_s"]

_SERVERS = ("sshd", "dropbear")
"""OpenSSH 9.8 and later call the process of a session `sshd-session`."""
_ANCESTORS = 20
_PARENT, _STARTED = 1, 19
"""Fields of /proc/PID/stat behind the name (proc(5): 4 and 22)."""


def began_s() -> float | None:
    """Seconds after the start of the computer, of the nearest server above us; None if we came by no SSH."""
    pid = "self"
    for _ in range(_ANCESTORS):
        try:
            text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        except OSError:
            return None
        name, fields = text.partition("(")[2].rpartition(")")[0], text.rpartition(")")[2].split()
        if name.startswith(_SERVERS):
            return int(fields[_STARTED]) / os.sysconf("SC_CLK_TCK")
        pid = fields[_PARENT]
        if pid == "0":
            return None
    return None
