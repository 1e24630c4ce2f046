"""Local processes, and programs on other computers: starting, reading, stopping."""

from __future__ import annotations

import os


def program_path() -> str:
    """Return PATH with the folders of system programs, which an ordinary user's may lack, and without empty entries."""
    folders = [*os.environ.get("PATH", os.defpath).split(os.pathsep), "/usr/sbin", "/sbin"]
    return os.pathsep.join(dict.fromkeys(filter(None, folders)))
