"""Everything of the running server that a technician's computer compares with what should be."""

from __future__ import annotations

import hashlib
import json
import os
import re
import stat
from typing import TYPE_CHECKING, Any

from .refused import Refused
from .vpn_server import ANSWERS, DOWN

if TYPE_CHECKING:
    from .vpn_server import Server

__all__ = ["look", "seen", "sessions"]

_VERSION = re.compile(r"OpenVPN (\S+)")


def look(server: Server) -> dict[str, Any]:
    """Look at all of it; what cannot be told is null. It changes nothing."""
    return {
        "clock": server.now(),
        "ready": server.tree.read(server.place.ca) is not None,
        "files": _files(server),
        "list": _list(server),
        **_firewall(server),
        "redirects": server.redirecting(),
        "version": _version(server),
        "package": _package(server),
        "unit": server.unit(),
        **sessions(server),
        **seen(server),
    }


def sessions(server: Server) -> dict[str, Any]:
    """Who has a session: by the server's word, else by its status file, `at` its time."""
    management, rows, why = server.sessions()
    at = server.now()
    if management not in (ANSWERS, DOWN):
        rows, at = server.from_file()
    return {"management": management, "sessions": rows, "at": at, "why": why}


def seen(server: Server) -> dict[str, Any]:
    """When each common name was last seen, as the server's timer has noted it."""
    try:
        noted = json.loads(server.tree.read(server.place.seen) or b"null")
    except ValueError:
        noted = None
    return {"seen": noted if isinstance(noted, dict) else None}


def _list(server: Server) -> dict[str, Any] | None:
    """The list of revoked certificates, itself as well: who asks compares it with what is recorded."""
    crl, pem = server.crl(), server.tree.read(server.place.crl)
    if crl is None or pem is None:
        return None
    values = {"number": crl.number, "begins": crl.begins, "ends": crl.ends, "signed": crl.signed}
    return {**values, "pem": pem.decode(errors="replace")}


def _files(server: Server) -> dict[str, str]:
    """SHA-256 of each live file, also of those that nobody has declared; `no file` for what is none."""
    place = server.place
    try:
        names = sorted(os.listdir(server.tree.at(place.ccd)))  # noqa: PTH208 - names are wanted
    except (FileNotFoundError, NotADirectoryError):
        names = []
    paths = [*(place.admission(name) for name in names), place.crl, place.firewall]
    return {path: _digest(server, path) for path in paths if os.path.lexists(server.tree.at(path))}


def _digest(server: Server, path: str) -> str:
    if not stat.S_ISREG(os.lstat(server.tree.at(path)).st_mode):
        return "no file"
    return hashlib.sha256(server.tree.read(path) or b"").hexdigest()


def _firewall(server: Server) -> dict[str, Any]:
    """Who passes, and whether the kernel has what the file says: `as_file` null where that cannot be told."""
    try:
        members = server.firewall.members()
        as_file = server.firewall.is_as(server.tree.at(server.place.firewall)) if members is not None else False
    except Refused as refused:
        return {"members": None, "as_file": None, "firewall_why": refused.message}
    return {"members": members, "as_file": as_file, "firewall_why": ""}


def _version(server: Server) -> str | None:
    found = _VERSION.match(server.run(["openvpn", "--version"]).said)
    return found[1] if found is not None else None


def _package(server: Server) -> str | None:
    done = server.run(["dpkg-query", "-W", "-f", "${Version}", "openvpn"])
    return done.said.strip() if done.code == 0 else None
