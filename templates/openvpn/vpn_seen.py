"""Note when each member of the VPN was last seen: `seen.json` beside, from the status file that OpenVPN writes.

The status file is rewritten in place, so that half of one may be read: without its last line it is left alone.
Python 3.8, standard library alone.
"""

# ruff: noqa: INP001 - a program of the server's computer, in no package

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

STATUS = "/run/atlantis-vpn/status"
SEEN = "/var/lib/atlantis/vpn/seen.json"
FORMAT = 1


def rows(text: str) -> tuple[int | None, list[dict[str, str]]]:
    """When a status of version 3 was written, and its rows `CLIENT_LIST` by the names of its header."""
    lines = [line.split("\t") for line in text.splitlines()]
    if not lines or lines[-1] != ["END"]:
        return None, []
    names = next((line[2:] for line in lines if line[:2] == ["HEADER", "CLIENT_LIST"]), [])
    time = next((int(line[2]) for line in lines if line[0] == "TIME"), None)
    return time, [dict(zip(names, line[1:])) for line in lines if line[0] == "CLIENT_LIST"]  # noqa: B905 - Python 3.8


def merged(seen: dict[str, Any], time: int, listed: list[dict[str, str]]) -> dict[str, Any]:
    """What was known and what is listed now; a client that has not proved who it is has no name yet."""
    for row in listed:
        name = row.get("Common Name", "UNDEF")
        if name != "UNDEF":
            seen[name] = {"last": time, "real": row["Real Address"], "address": row["Virtual Address"]}
    return seen


def known(path: Path) -> dict[str, Any]:
    """What was noted before; a file that is no longer readable is begun again."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        return dict(told["seen"]) if told["format"] == FORMAT else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def main(status: str = STATUS, place: str = SEEN) -> None:
    """Read, and write whole or not at all; no status is no news."""
    path = Path(place)
    try:
        time, listed = rows(Path(status).read_text(encoding="utf-8", errors="replace"))
    except FileNotFoundError:
        return
    if time is None:
        return
    beside = path.with_name(f".{path.name}.new")
    with beside.open("w", encoding="utf-8") as file:
        json.dump({"format": FORMAT, "seen": merged(known(path), time, listed)}, file, indent=1, sort_keys=True)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)  # noqa: PTH105 - the system call


if __name__ == "__main__":
    main(*sys.argv[1:])
