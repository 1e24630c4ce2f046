"""Runs on a gateway computer and answers all questions of the checks at once, as JSON: one round trip a computer.

Takes the questions as JSON in its first argument. Reads only. Python 3.8 and the standard library: Ubuntu 20.04 has no
more. What cannot be answered is answered with None or left empty, and the check of it says so.
"""

from __future__ import annotations

import grp
import hashlib
import json
import os
import pwd
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_TIMEOUT_S = 60
_PACKAGE = "${db:Status-Abbrev}\\t${Package}\\t${Version}\\n"
_UNIT = "LoadState,ActiveState,SubState,UnitFileState,MainPID"


def output_of(*argv: str) -> str | None:
    """What a program prints; None where it is missing, fails or hangs."""
    environment = {"PATH": _PATH, "LC_ALL": "C.UTF-8", "HOME": "/root"}
    try:
        done = subprocess.run(
            argv,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.decode(errors="replace") if done.returncode == 0 else None


def stands(path: str) -> dict[str, Any] | None:
    """What stands at a path: kind, mode, owner, and the SHA-256 of what is in a file."""
    place = Path(path)
    try:
        result = place.lstat()
    except OSError:
        return None
    owner, group = _named(pwd.getpwuid, result.st_uid), _named(grp.getgrgid, result.st_gid)
    found = {"kind": "other", "mode": f"{stat.S_IMODE(result.st_mode):04o}", "owner": owner, "group": group}
    if stat.S_ISDIR(result.st_mode):
        found["kind"] = "directory"
    elif stat.S_ISLNK(result.st_mode):
        found.update(kind="link", target=os.readlink(path))
    elif stat.S_ISREG(result.st_mode):
        found.update(kind="file", sha256=hashlib.sha256(place.read_bytes()).hexdigest())
    return found


def _named(look: Any, number: int) -> str:  # noqa: ANN401 - getpwuid or getgrgid
    try:
        return str(look(number)[0])
    except KeyError:
        return str(number)


def below(folder: str) -> list[str]:
    """Every file and link below a folder."""
    return sorted(str(Path(at, name)) for at, _, names in os.walk(folder) for name in names)


def text(path: str) -> str | None:
    """What is in a file."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None


def installed(names: list[str]) -> dict[str, str]:
    """Package -> version, of those that are wholly installed."""
    listed = output_of("sh", "-c", 'dpkg-query -W -f "$@" || true', "sh", _PACKAGE, "--", *names) if names else ""
    rows = [line.split("\t") for line in (listed or "").splitlines()]
    return {name: version for status, name, version in rows if status.strip() in ("ii", "hi")}


def unit(name: str) -> dict[str, str]:
    """What systemd tells of a unit."""
    return pairs((output_of("systemctl", "show", "--property", _UNIT, "--", name) or "").splitlines())


def environment_of(name: str) -> dict[str, str] | None:
    """The environment of a unit's main process; None where none runs."""
    try:
        raw = Path("/proc", unit(name).get("MainPID", "0"), "environ").read_bytes()
    except OSError:
        return None
    return pairs(raw.decode(errors="replace").split("\0"))


def pairs(lines: list[str]) -> dict[str, str]:
    """Lines of NAME=VALUE."""
    return dict(line.split("=", 1) for line in lines if "=" in line)


def room(path: str) -> dict[str, float]:
    """What is left for the system's own programs: 10^6 bytes, and shares of all blocks and of all inodes."""
    result = os.statvfs(path)
    return {
        "free_mb": result.f_bavail * result.f_frsize / 1e6,
        "free": result.f_bavail / max(result.f_blocks, 1),
        "free_inodes": result.f_favail / result.f_files if result.f_files else 1.0,
    }


def answers(questions: dict[str, Any]) -> dict[str, Any]:
    """The answers, by the kind of question."""
    return {
        "files": {path: stands(path) for path in questions["files"]},
        "folders": {folder: below(folder) for folder in questions["folders"]},
        "texts": {path: text(path) for path in questions["texts"]},
        "units": {name: unit(name) for name in questions["units"]},
        "environments": {name: environment_of(name) for name in questions["environments"]},
        "packages": installed(questions["packages"]),
        "room": {path: room(path) for path in questions["room"]},
        "said": {name: output_of(*argv) for name, argv in questions["said"].items()},
        "now": time.time(),
    }


if __name__ == "__main__":
    json.dump(answers(json.loads(sys.argv[1])), sys.stdout)
