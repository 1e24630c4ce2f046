"""The running VPN server: its paths, its sessions, its CRL, and its table in the kernel.

The technician's computer sends the paths with each request. The firewall is loaded from its file in one step, and read
back.

The CRL is checked before OpenVPN gets it, as `openssl crl` reads it: OpenVPN fails open on a CRL of another authority,
and locks everybody out with one that is not yet valid, expired or truncated.
"""

from __future__ import annotations

import calendar
import contextlib
import hashlib
import json
import os
import re
import time
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_network, summarize_address_range
from typing import Any, Callable, Iterable, Iterator

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError
from .filesystem import FileSystem, Stamps
from .programs import ProgramResult, last_lines, run
from .vpn_management import (
    ConnectionEnd,
    IncompleteStatus,
    ManagementBusy,
    ManagementSocket,
    ServerDown,
    Session,
    open_socket,
    parse_status_time,
    sessions,
)

_SERIAL = re.compile(r"^ +Serial Number: ([0-9A-F]+)$", re.MULTILINE)
_HINT = "`provision vpn status` shows what is wrong with the authority's own list"


@dataclass(frozen=True)
class Crl:
    """Content of a certificate revocation list (CRL); times in seconds since 1970."""

    number: int
    begins: int
    ends: int
    is_signed: bool
    """Whether it is signed by the authority whose members this server accepts."""
    serials: frozenset[str] = frozenset()
    """Serial numbers of the revoked certificates, in hex."""


def read(path: str, ca: str, run: Callable[[list[str]], ProgramResult]) -> Crl | None:
    """Read a CRL; None if it is not a valid CRL or does not exist."""
    words = ["openssl", "crl", "-in", path, "-noout", "-text", "-crlnumber", "-lastupdate", "-nextupdate"]
    result = run([*words, "-verify", "-CAfile", ca])
    if result.code != 0:  # it has not even found the issuer's certificate
        result = run(words)
    values = dict(line.split("=", 1) for line in result.output.splitlines() if "=" in line)
    try:
        number = int(values["crlNumber"], 16)
        begins, ends = (_seconds(values[name]) for name in ("lastUpdate", "nextUpdate"))
    except (KeyError, ValueError):
        return None
    return Crl(
        number, begins, ends, "verify OK" in result.output.splitlines(), frozenset(_SERIAL.findall(result.output))
    )


def accept(new: Crl | None, old: Crl | None, now: float) -> Crl:
    """Check that a new CRL may replace the old one: it must not be older or of another branch.

    A certificate authority restored from an older copy reuses the numbers of CRLs that it does not know.
    """
    if new is None:
        raise ModuleError("the new list of revoked certificates cannot be read", _HINT)
    if not new.is_signed:
        raise ModuleError(
            "the new list of revoked certificates is from another authority than this server's: OpenVPN would let "
            "every revoked member in",
            "the server was set up by another authority: `provision site=…` installs this one",
        )
    if old is not None and old.is_signed and new != old:
        _require_newer_crl(new, old)
    if new.begins > now:
        raise ModuleError(
            f"by the server's clock ({arg(_format_time(now))}) the new list of revoked certificates is not valid yet: "
            "nobody could connect",
            "set the clocks: `date` on both computers, `timedatectl` on the server",
        )
    if new.ends <= now:
        raise ModuleError(
            f"by the server's clock ({arg(_format_time(now))}) the new list of revoked certificates has expired: "
            "nobody could connect",
            "check `date` on the server; if it is right, `provision vpn sync --sign` signs a new list",
        )
    return new


def _require_newer_crl(new: Crl, old: Crl) -> None:
    lost_count = len(old.serials - new.serials)
    if new.number > old.number and not lost_count:
        return
    why = msg(f"has number {arg(new.number)}, but the server has number {arg(old.number)}")
    if new.number == old.number:
        why = msg(f"has number {arg(new.number)} like the server's, but differs from it")
    elif new.number > old.number:
        why = msg(f"lacks {arg(lost_count)} of the certificates that are revoked on the server")
    raise ModuleError(
        f"the new list of revoked certificates {arg(why)}: a revoked member could connect again",
        f"this is not the newest copy of the authority: find the one that made list {arg(old.number)}; `provision vpn "
        "status` shows what the server knows beyond this copy, and what to do if the newest copy is lost",
    )


def _seconds(text: str) -> int:
    """Parse a time in OpenSSL's format: Nov 22 06:46:31 2026 GMT."""
    return calendar.timegm(time.strptime(text.strip(), "%b %d %H:%M:%S %Y GMT"))


def _format_time(now: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(now))


_VOLATILE = ("handle", "index", "counter", "metainfo")


@dataclass(frozen=True)
class Firewall:
    """The VPN's nft table on this computer."""

    place: ServerPlace
    tree: FileSystem
    stamps: Stamps
    run: Callable[[list[str]], ProgramResult]

    def load(self, content: bytes, source: str) -> None:
        """Load the file `source` with that content, and record it as the role's unit would. Raises `ModuleError`."""
        name, digests = self._stamp(content)
        self.stamps.begin(name, digests)
        self.load_only(source)
        self.stamps.note(name, digests)

    def load_only(self, source: str, also: str = "") -> None:
        """Load a file, and in the same transaction other nft commands, without recording it."""
        result = self.run(["nft", f'include "{source}"\n{also}'] if also else ["nft", "-f", source])
        if result.code != 0:
            raise ModuleError(
                "the firewall of the VPN could not be loaded and is unchanged (exit "
                f"{arg(result.code)}):\n{arg(last_lines(result.output))}",
                "on the server, `nft -c -f` with the file's name shows more",
            )

    def note(self, content: bytes) -> None:
        """Note that a ruleset is loaded, so that the next run of the role leaves its unit alone."""
        self.stamps.note(*self._stamp(content))

    def is_noted(self, content: bytes) -> bool:
        """Return whether the toolkit's records have that ruleset as the last one loaded."""
        return self.stamps.holds(*self._stamp(content))

    def take_out(self, addresses: Iterable[str]) -> None:
        """Remove addresses from the set of members, one by one, when the whole ruleset cannot be loaded."""
        for address in addresses:
            self.run(["nft", "delete", "element", *self.place.table.split(), self.place.members, f"{{ {address} }}"])

    def read_table(self) -> list[dict[str, Any]] | None:
        """Return the table from the kernel; None if it does not exist. Raises `ModuleError` if nft fails."""
        result = self.run(["nft", "-j", "-s", "list", "table", *self.place.table.split()])
        return _objects(result)

    def members(self) -> list[str] | None:
        """Return the networks of admitted members from the kernel; None if the set does not exist."""
        result = self.run(["nft", "-j", "list", "set", *self.place.table.split(), self.place.members])
        objects = _objects(result)
        sets = [row["set"] for row in objects or () if "set" in row]
        return sorted(network for item in sets for network in _networks(item.get("elem", ()))) if sets else None

    def matches_file(self, path: str) -> bool | None:
        """Return whether the kernel's table equals a file's result in an empty network namespace; None if unknown."""
        here = self.read_table()
        if here is None:
            return False
        table = " ".join(self.place.table.split())
        script = f'nft -f "$1" && nft -j -s list table {table}'
        result = self.run(["unshare", "--net", "sh", "-c", script, "sh", path])
        if result.code != 0:
            return None
        return bool(_plain(here) == _plain(_objects(result)))

    def _stamp(self, content: bytes) -> tuple[str, dict[str, str]]:
        return f"unit {self.place.firewall_unit}", {self.place.firewall: hashlib.sha256(content).hexdigest()}


def _objects(result: ProgramResult) -> list[dict[str, Any]] | None:
    if result.code != 0:
        if "No such file or directory" in result.output:
            return None
        raise ModuleError(
            f"nft failed (exit {arg(result.code)}):\n{arg(last_lines(result.output))}", "install nftables"
        )
    try:
        return list(json.loads(result.output)["nftables"])
    except (ValueError, KeyError, TypeError) as error:
        raise ModuleError(f"nft returned invalid JSON: {arg(last_lines(result.output))}", "") from error


def _networks(elements: Iterable[Any]) -> list[str]:
    """Convert elements of an nft address set to networks; an element may be text, prefix, range, or have options."""
    result: list[str] = []
    for element in elements:
        value = element["elem"]["val"] if isinstance(element, dict) and "elem" in element else element
        if isinstance(value, dict) and "prefix" in value:
            result.append(str(ip_network(f"{value['prefix']['addr']}/{value['prefix']['len']}")))
        elif isinstance(value, dict) and "range" in value:
            first, last = map(ip_address, value["range"])
            result += map(str, summarize_address_range(first, last))
        else:
            result.append(str(ip_network(str(value))))
    return result


def _plain(data: Any) -> Any:  # noqa: ANN401 - JSON
    """Remove what differs from load to load: kernel handles, counters, and the order of elements."""
    if isinstance(data, dict):
        plain = {key: _plain(value) for key, value in data.items() if key not in _VOLATILE}
        if isinstance(plain.get("elem"), list):
            plain["elem"] = sorted(plain["elem"], key=lambda entry: json.dumps(entry, sort_keys=True))
        return plain
    return [_plain(item) for item in data] if isinstance(data, list) else data


ANSWERS, BUSY, DOWN = "answers", "held", "down"
"""State of the management socket; `held`: another client uses it, or the server hangs."""
_SILENT = (ManagementBusy, ConnectionEnd, IncompleteStatus)
_CONF = "/proc/sys/net/ipv4/conf"


@dataclass(frozen=True)
class ManagedServer:
    """Files, firewall and management socket of one server. Tests replace `run` and `now`."""

    place: ServerPlace
    tree: FileSystem = field(default_factory=FileSystem)
    run: Callable[[list[str]], ProgramResult] = run
    now: Callable[[], float] = time.time

    @property
    def stamps(self) -> Stamps:
        """The toolkit's records on this computer."""
        return Stamps(self.tree)

    @property
    def firewall(self) -> Firewall:
        """The VPN's table."""
        return Firewall(self.place, self.tree, self.stamps, self.run)

    def require_installed(self) -> None:
        """Raise ModuleError if the server was never set up on this computer."""
        if self.tree.read(self.place.ca) is None:
            raise ModuleError(
                "no VPN server was ever set up on this computer",
                "`provision site=…` does that; then run the same command again",
            )

    def list_admitted_names(self) -> list[str]:
        """Return the common names that have an admission file, whatever its content."""
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            return sorted(name for name in os.listdir(self.tree.at(self.place.ccd)) if not name.startswith("."))  # noqa: PTH208 - names are wanted
        return []

    def crl(self, path: str | None = None) -> Crl | None:
        """Return the CRL at its regular path, or at another one."""
        return read(path or self.tree.at(self.place.crl), self.tree.at(self.place.ca), self.run)

    def check_crl(self, beside: str) -> None:
        """Check that a staged CRL may replace the current one. Raises `ModuleError`."""
        there = self.tree.read(self.place.crl) is not None
        accept(self.crl(beside), self.crl() if there else None, self.now())

    def redirect_interfaces(self) -> list[str]:
        """Return interfaces on which the kernel may send ICMP redirects to members; `default`: future interfaces."""
        folder = self.tree.at(_CONF)
        try:
            names = sorted(os.listdir(folder))  # noqa: PTH208 - names are wanted
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [name for name in names if (self.tree.read(f"{_CONF}/{name}/send_redirects") or b"0").strip() != b"0"]

    def stop_redirects(self) -> bool:
        """Switch off ICMP redirects; return whether anything had to be changed."""
        names = self.redirect_interfaces()
        for name in names:
            with open(self.tree.at(f"{_CONF}/{name}/send_redirects"), "w") as file:  # noqa: PTH123 - as in `tree`
                file.write("0\n")
        return bool(names)

    @contextlib.contextmanager
    def connection(self, patience_s: float | None = None) -> Iterator[ManagementSocket]:
        """Open a connection to the server. Raises `ServerDown`, `ManagementBusy`, `ConnectionEnd`."""
        patience_s = self.place.patience_s if patience_s is None else patience_s
        with open_socket(self.tree.at(self.place.socket), patience_s) as management:
            management.wait_for_greeting()
            yield management

    def sessions(self) -> tuple[str, list[Session], str]:
        """Return the state of the socket, the sessions that it reports, and why it reports none."""
        try:
            with self.connection() as management:
                return ANSWERS, management.sessions(), ""
        except ServerDown as down:
            return DOWN, [], str(down)
        except _SILENT as silent:
            return BUSY, [], str(silent)

    def from_file(self) -> tuple[list[Session], int]:
        """Return the sessions in the status file and its time; time 0: it cannot be read."""
        lines = (self.tree.read(self.place.status) or b"").decode(errors="replace").splitlines()
        try:
            return sessions(lines), parse_status_time(lines)
        except IncompleteStatus:
            return [], 0

    def unit(self) -> dict[str, str]:
        """Return systemd's properties of the unit; empty if systemctl fails."""
        properties = "LoadState,ActiveState,SubState,MainPID"
        result = self.run(["systemctl", "show", "--property", properties, "--", self.place.unit])
        if result.code != 0:
            return {}
        return dict(line.split("=", 1) for line in result.output.splitlines() if "=" in line)

    def is_down(self) -> bool:
        """Return whether the server certainly does not run, so that no session exists; the socket alone is no proof."""
        values = self.unit()
        return values.get("LoadState") == "loaded" and values.get("MainPID") == "0"


@dataclass(frozen=True)
class ServerPlace:
    """Absolute paths and names of a VPN server."""

    ca: str
    ccd: str
    """Folder managed by this toolkit alone, with one file per admitted common name."""
    crl: str
    firewall: str
    """Path of the ruleset file."""
    table: str
    """nft table that the ruleset creates, with its family."""
    members: str
    """nft set in that table with the addresses of all admitted members."""
    socket: str
    status: str
    seen: str
    unit: str
    """systemd unit that runs the server."""
    firewall_unit: str
    """systemd unit that loads the ruleset; its stamp records which ruleset was loaded."""
    patience_s: float = 2.0
    """Timeout of the management socket."""

    def admission(self, common_name: str) -> str:
        """Return the file that admits a common name."""
        return f"{self.ccd}/{common_name}"
