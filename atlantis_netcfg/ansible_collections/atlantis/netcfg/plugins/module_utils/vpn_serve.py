"""Serve one request per line until standard input ends: after its start, each costs one round trip of the link.

A line is JSON, compressed and in base64, in both directions. `MARK` precedes each response, because shells print
greetings. Requests are `{"id": …, "do": …, "place": {…}, …}`. Responses have the same id, and `done`, `refused` (with a
hint), or `broken`.

`look` reads everything of the running server that the technician's computer compares with the inventory. `push` puts
the live files in place while the tunnel is up: admissions, CRL, firewall. It uses the core of the module that
configures files and records what is loaded in its stamps, so that a run of the role finds nothing to do. The session of
a member who is no longer admitted is ended.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import platform
import re
import signal
import stat
import sys
import zlib
from typing import Any, Callable, Mapping, Sequence

from atlantis_netcfg.core.stored_messages import pack

from .desired_state import DesiredState
from .errors import ModuleError, as_module_error
from .file_transaction import FileTransaction, clear, unknown_paths
from .ssh_access import hold_lock
from .vpn_disconnect import ClientBlock, SessionTermination, revoke, verify
from .vpn_server import ANSWERS, DOWN, ManagedServer, ServerPlace

_VERSION = re.compile(r"OpenVPN (\S+)")


def look(server: ManagedServer) -> dict[str, Any]:
    """Read the complete state of the server; what cannot be read is null. Changes nothing."""
    return {
        "clock": server.now(),
        "ready": server.tree.read(server.place.ca) is not None,
        "files": _files(server),
        "list": _list(server),
        **_firewall(server),
        "redirects": server.redirect_interfaces(),
        "version": _version(server),
        "package": _package(server),
        "unit": server.unit(),
        **sessions(server),
        **read_last_seen(server),
    }


def sessions(server: ManagedServer) -> dict[str, Any]:
    """Return the sessions as reported by the server, else from its status file, with the time `at`."""
    management, rows, why = server.sessions()
    at = server.now()
    if management not in (ANSWERS, DOWN):
        rows, at = server.from_file()
    return {"management": management, "sessions": rows, "at": at, "why": why}


def read_last_seen(server: ManagedServer) -> dict[str, Any]:
    """Return when each common name was last seen, as recorded by the server's timer."""
    try:
        data = json.loads(server.tree.read(server.place.seen) or b"null")
    except ValueError:
        data = None
    return {"seen": data if isinstance(data, dict) else None}


def _list(server: ManagedServer) -> dict[str, Any] | None:
    """Return the CRL's data and PEM text, which the caller compares with the recorded one."""
    crl, pem = server.crl(), server.tree.read(server.place.crl)
    if crl is None or pem is None:
        return None
    values = {"number": crl.number, "begins": crl.begins, "ends": crl.ends, "signed": crl.is_signed}
    return {**values, "pem": pem.decode(errors="replace")}


def _files(server: ManagedServer) -> dict[str, str]:
    """Return the SHA-256 of each live file, also of unknown ones; `no file` if it is not a regular file."""
    place = server.place
    try:
        names = sorted(os.listdir(server.tree.at(place.ccd)))  # noqa: PTH208 - names are wanted
    except (FileNotFoundError, NotADirectoryError):
        names = []
    paths = [*(place.admission(name) for name in names), place.crl, place.firewall]
    return {path: _digest(server, path) for path in paths if os.path.lexists(server.tree.at(path))}


def _digest(server: ManagedServer, path: str) -> str:
    if not stat.S_ISREG(os.lstat(server.tree.at(path)).st_mode):
        return "no file"
    return hashlib.sha256(server.tree.read(path) or b"").hexdigest()


def _firewall(server: ManagedServer) -> dict[str, Any]:
    """Return the admitted members, and whether the kernel's table matches the file; `as_file` is null if unknown."""
    try:
        members = server.firewall.members()
        as_file = server.firewall.matches_file(server.tree.at(server.place.firewall)) if members is not None else False
    except ModuleError as refused:
        return {"members": None, "as_file": None, "firewall_why": refused.message}
    return {"members": members, "as_file": as_file, "firewall_why": ""}


def _version(server: ManagedServer) -> str | None:
    match = _VERSION.match(server.run(["openvpn", "--version"]).output)
    return match[1] if match is not None else None


def _package(server: ManagedServer) -> str | None:
    result = server.run(["dpkg-query", "-W", "-f", "${Version}", "openvpn"])
    return result.output.strip() if result.code == 0 else None


def push(server: ManagedServer, files: Sequence[Mapping[str, Any]], only: Sequence[str]) -> dict[str, Any]:
    """Install files; `files` as for `configure`, or with `sha256` instead of a content that may be there already.

    `only` are folders from which all other files are removed. Returns `changes`, `ended` (sessions, with replies) and
    `told`; or `lacks`, the paths whose content is needed after all, in which case nothing was done.
    """
    server.require_installed()
    with hold_lock(server.tree):
        whole = [_whole(server, file) for file in files]
        lacks = [file["path"] for file in whole if file["content"] is None]
        if lacks:
            return {"lacks": lacks, "changes": [], "ended": [], "told": []}
        values = {"files": whole, "only": list(only)}
        wishes = DesiredState.of(values)
        stray_paths = unknown_paths(server.tree, wishes)
        wishes = DesiredState.of({**values, "absent": stray_paths})
        contents = {file.path: file.data for file in wishes.files}
        _hold_list(server, contents.get(server.place.crl))
        before = set(server.list_admitted_names())
        placing = FileTransaction(server.tree, wishes, server.run)
        placing.place()
        clear(server.tree, wishes, stray_paths)
        changes = [*placing.changes(), *_load(server, contents.get(server.place.firewall)), *_redirects(server)]
        removed_names = before - set(server.list_admitted_names())
        ending = SessionTermination(removed_names)
        if removed_names:
            ending.run(server, ClientBlock(server, ()))
    return {"lacks": [], "changes": changes, "ended": ending.ended, "told": ending.messages}


def _whole(server: ManagedServer, file: Mapping[str, Any]) -> dict[str, Any]:
    """Return the file entry with its content, if that was sent or is on the computer; otherwise with None."""
    values = dict(file)
    digest = values.pop("sha256", None)
    if values.get("content") is None:
        content = server.tree.read(values["path"])
        same = content is not None and hashlib.sha256(content).hexdigest() == digest
        values["content"] = content.decode() if content is not None and same else None
    return values


def _hold_list(server: ManagedServer, new: bytes | None) -> None:
    """Check a CRL that differs from the current one against that one and against the clock."""
    path = server.place.crl
    if new is None or new == server.tree.read(path):
        return
    beside = server.tree.stage(path, new, 0o600, os.geteuid(), os.getegid())
    try:
        server.check_crl(beside)
    finally:
        server.tree.unstage(path)


def _redirects(server: ManagedServer) -> list[str]:
    """Switch ICMP redirects off; ignore errors, because `look` reports redirects that are still on."""
    with contextlib.suppress(OSError):
        if server.stop_redirects():
            return ["ICMP redirects disabled"]
    return []


def _load(server: ManagedServer, ruleset: bytes | None) -> list[str]:
    """Load the ruleset unless it is the last one loaded and still in the kernel."""
    firewall, path = server.firewall, server.tree.at(server.place.firewall)
    if ruleset is None or (firewall.is_noted(ruleset) and firewall.matches_file(path) is not False):
        return []
    firewall.load(ruleset, path)
    return ["firewall loaded"]


MARK = "ATLANTIS-VPN "
_DOES: dict[str, Callable[..., dict[str, Any]]] = {
    "look": look,
    "sessions": sessions,
    "seen": read_last_seen,
    "push": push,
    "revoke": revoke,
    "verify": verify,
}


def pack_line(values: dict[str, Any]) -> bytes:
    """Encode a line, without its line end."""
    return base64.b64encode(zlib.compress(json.dumps(values, separators=(",", ":")).encode(), 6))


def unpack_line(line: bytes) -> dict[str, Any]:
    """Decode a line. Raises ValueError if it is damaged."""
    try:
        result = json.loads(zlib.decompress(base64.b64decode(line, validate=True)).decode())
    except zlib.error as error:
        raise ValueError(f"a line is incomplete: {error}") from error
    if not isinstance(result, dict):
        raise ValueError("a line is not a request")  # noqa: TRY004 - as any other that is torn
    return result


def main() -> None:
    """Serve requests until the input ends. A link that breaks does not stop a request in progress."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    _write_response({"id": 0, "done": {"python": platform.python_version(), "root": os.geteuid() == 0}})
    for line in iter(sys.stdin.buffer.readline, b""):
        _write_response(_answer_request(line.strip()))


def _answer_request(line: bytes) -> dict[str, Any]:
    number = None
    try:
        request = unpack_line(line)
        number = request.pop("id")
        server = ManagedServer(ServerPlace(**request.pop("place")))
        return {"id": number, "done": _DOES[request.pop("do")](server, **request)}
    except ModuleError as refused:
        return {"id": number, "refused": refused.message, "hint": refused.hint}
    except OSError as error:
        reply = as_module_error(error, str(error.filename or "a file"))
        return {"id": number, "refused": reply.message, "hint": reply.hint}
    except Exception as error:  # noqa: BLE001 - whoever asks is told, and goes on asking
        return {"id": number, "broken": f"{type(error).__name__}: {error}"}


def _write_response(values: dict[str, Any]) -> None:
    sys.stdout.buffer.write(MARK.encode() + pack_line(pack(values)) + b"\n")
    sys.stdout.buffer.flush()
