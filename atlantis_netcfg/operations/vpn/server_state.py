"""The state reported by the running server, and its differences from the record."""

from __future__ import annotations

import hashlib
import time
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.computers.remote_session import AnswerLost, ServerLink
from atlantis_netcfg.vpn import server
from atlantis_netcfg.vpn.policy import MEMBERS_SET, TABLE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.computers.parts import File
    from atlantis_netcfg.vpn.identity import MembershipList


PLACE: Mapping[str, str] = {
    "ca": f"{server.FOLDER}/ca.crt",
    "ccd": server.CCD,
    "crl": f"{server.FOLDER}/crl.pem",
    "firewall": server.FIREWALL,
    "table": f"inet {TABLE}",
    "members": MEMBERS_SET,
    "socket": server.MANAGEMENT,
    "status": server.STATUS,
    "seen": server.SEEN_FILE,
    "unit": server.SERVICE,
    "firewall_unit": "atlantis-vpn-firewall.service",
}
"""Paths on the server, sent with every request."""
_ANSWERS = "answers"


@dataclass(frozen=True, slots=True)
class VpnSession:
    """A session on the server."""

    common_name: str
    """`UNDEF` until a certificate is received."""
    real: str
    """Address and port of the client."""
    address: str
    """Address in the VPN; empty: the handshake is not complete."""
    since: datetime
    received_bytes: int
    sent_bytes: int

    @property
    def is_up(self) -> bool:
        """Whether the session's client was admitted."""
        return bool(self.address)

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {
            "common_name": self.common_name,
            "real": self.real,
            "address": self.address,
            "since": self.since.isoformat(),
            "received_bytes": self.received_bytes,
            "sent_bytes": self.sent_bytes,
        }


@dataclass(frozen=True, slots=True)
class Crl:
    """The server's list of revoked certificates."""

    number: int
    begins: datetime
    ends: datetime
    is_signed: bool
    """Whether it is signed by the authority whose certificate is on the server."""
    pem: str = ""


@dataclass(frozen=True, slots=True)
class ServerState:
    """The state of the server, for `provision vpn status`."""

    ready: bool
    """Whether the role has set up the server."""
    files: Mapping[str, str]
    """SHA-256 of each existing live file, by path."""
    crl: Crl | None
    """None: missing or not readable; then nobody can connect."""
    members: tuple[IPv4Network, ...] | None
    """Addresses that pass the firewall; None: it is not loaded, or does not respond."""
    firewall_as_file: bool | None
    """Whether the kernel's firewall matches its file; None: cannot be determined."""
    firewall_why: str
    redirects: tuple[str, ...]
    """Interfaces on which the server's kernel may send ICMP redirects, so that members bypass it."""
    version: str | None
    """Version of OpenVPN."""
    package: str | None
    """Version of OpenVPN's Debian package."""
    unit: Mapping[str, str]
    """Properties of the server's unit, from systemd."""
    sessions: tuple[VpnSession, ...]
    is_live: bool
    """Whether the sessions are live, from the server itself; otherwise they are from its status file."""
    why: str
    """Why the sessions are not live."""
    at: datetime
    """Time of the session list, by the server's clock."""
    last_sessions: Mapping[str, datetime]
    """Time of the last session by common name, as recorded by the server's timer."""
    clock: datetime
    clock_ahead_s: float
    """Seconds by which the server's clock is ahead of this computer's."""

    @property
    def active(self) -> bool | None:
        """Whether the server's unit runs; None if systemd does not report it."""
        return self.unit["ActiveState"] == "active" if "ActiveState" in self.unit else None


@contextmanager
def read_answer(do: str) -> Iterator[None]:
    """Convert errors in parsing a response, which are the server's fault, to AnswerLost."""
    try:
        yield
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError, OSError) as error:
        raise AnswerLost(
            f"the server sent an invalid response to `{arg(do)}` ({arg(type(error).__name__)}: {arg(error)})",
            hint="check that computer and who else has worked on it, then run the same command again",
        ) from error


def observe(link: ServerLink) -> ServerState:
    """Read the server's state in one request; raise ServerAway, AnswerLost or ServerRefusal."""
    began = time.time()
    values = link.ask("look", place=dict(PLACE))
    middle = (began + time.time()) / 2
    with read_answer("look"):
        return _state(values, middle)


def _state(values: Mapping[str, Any], middle: float) -> ServerState:
    return ServerState(
        ready=values["ready"] is True,
        files=_texts(values["files"]),
        crl=_crl(values["list"]),
        members=tuple(map(IPv4Network, values["members"])) if values["members"] is not None else None,
        firewall_as_file=None if values["as_file"] is None else values["as_file"] is True,
        firewall_why=str(values["firewall_why"]),
        redirects=tuple(map(str, values["redirects"])),
        version=_text(values["version"]),
        package=_text(values["package"]),
        unit=_texts(values["unit"]),
        sessions=sessions_of(values),
        is_live=values["management"] == _ANSWERS,
        why=str(values["why"]),
        at=_moment(values["at"]),
        last_sessions=_parse_last_sessions(values["seen"]),
        clock=_moment(values["clock"]),
        clock_ahead_s=float(values["clock"]) - middle,
    )


def sessions_of(values: Mapping[str, Any]) -> tuple[VpnSession, ...]:
    """Parse the sessions in a response."""
    return tuple(
        VpnSession(
            str(item["common_name"]),
            str(item["real"]),
            str(item["virtual"]),
            _moment(item["since"]),
            int(item["received"]),
            int(item["sent"]),
        )
        for item in values["sessions"]
    )


def _crl(values: Mapping[str, Any] | None) -> Crl | None:
    if values is None:
        return None
    begins, ends = _moment(values["begins"]), _moment(values["ends"])
    return Crl(int(values["number"]), begins, ends, values["signed"] is True, str(values["pem"]))


def _parse_last_sessions(record: Mapping[str, Any] | None) -> dict[str, datetime]:
    rows = (record or {}).get("seen")
    if not isinstance(rows, dict):
        return {}
    return {
        name: _moment(row["last"])
        for name, row in rows.items()
        if isinstance(row, dict) and isinstance(row.get("last"), int | float)
    }


def _text(result: object) -> str | None:
    return None if result is None else str(result)


def _texts(values: Mapping[str, object]) -> dict[str, str]:
    return {str(name): str(value) for name, value in values.items()}


def _moment(seconds: float) -> datetime:
    return datetime.fromtimestamp(seconds, UTC)


ALARM = timedelta(days=30)
"""Remaining validity at which a list must be signed again; after it has expired, nobody can connect."""
_CLOCK_S = 60.0
_CRL = f"{server.FOLDER}/crl.pem"


def drift(state: ServerState, files: Sequence[File], membership: MembershipList) -> tuple[str, ...]:
    """Return the differences between running server and ledger as text; `files` come from `live_files`. Pure."""
    if not state.ready:
        return ("no VPN server was ever set up there",)
    return (
        *_admissions(state, files),
        *_crl_drift(state, files, membership),
        *_firewall(state, files),
        *_service_drift(state),
    )


def _admissions(state: ServerState, desired_files: Sequence[File]) -> Iterator[str]:
    files = {file.path: file for file in desired_files if file.path.startswith(f"{server.CCD}/")}
    for path, file in files.items():
        name, digest = path.rpartition("/")[2], state.files.get(path)
        if digest is None:
            yield msg(f"{arg(name)} is in the record, but the server does not admit it")
        elif digest != _sha256(file):
            yield msg(f"{arg(name)}: its file on the server differs from the record ({arg(path)})")
    for path in state.files:
        if path.startswith(f"{server.CCD}/") and path not in files:
            yield msg(
                f"{arg(path.rpartition('/')[2])} must not be admitted, but the server has a file that admits it "
                f"({arg(path)})"
            )


def _crl_drift(state: ServerState, files: Sequence[File], membership: MembershipList) -> Iterator[str]:
    crl = state.crl
    if crl is None:
        yield "the server has no readable revocation list: nobody can connect"
        return
    if not crl.is_signed:
        yield "the server's revocation list is from another authority: revoked members can connect"
    elif crl.number < membership.crl_number:
        yield msg(f"the server has revocation list {arg(crl.number)}, the record has {arg(membership.crl_number)}")
    elif crl.number > membership.crl_number:
        yield msg(
            f"the server has revocation list {arg(crl.number)}, newer than the record's "
            f"({arg(membership.crl_number)}): somebody works with another copy of the authority"
        )
    elif any(file.path == _CRL and state.files.get(_CRL) != _sha256(file) for file in files):
        yield msg(f"the server's revocation list has the record's number {arg(crl.number)}, but a different content")
    yield from _crl_validity(crl, state)


def _crl_validity(crl: Crl, state: ServerState) -> Iterator[str]:
    if crl.begins > state.clock:
        yield msg(
            f"by the server's clock, its revocation list is not valid before {arg(crl.begins):%Y-%m-%d %H:%M} UTC"
        )
    elif crl.ends <= state.clock:
        yield msg(f"the server's revocation list expired on {arg(crl.ends):%Y-%m-%d}: nobody can connect")
    elif crl.ends - state.clock < ALARM:
        days = (crl.ends - state.clock).days
        yield msg(
            f"the server's revocation list expires in {arg(days)} days, on {arg(crl.ends):%Y-%m-%d}: after that nobody "
            "can connect"
        )


def _firewall(state: ServerState, files: Sequence[File]) -> Iterator[str]:
    if any(file.path == server.FIREWALL and state.files.get(server.FIREWALL) != _sha256(file) for file in files):
        yield msg(f"the firewall file differs from the record ({arg(server.FIREWALL)})")
    if state.firewall_why:
        yield msg(f"the firewall cannot be read: {arg(state.firewall_why)}")
    elif state.members is None:
        yield "the firewall of the VPN is not loaded"
    elif state.firewall_as_file is False:
        yield "the loaded firewall differs from its file, for example after a change with nft"
    if state.redirects:
        yield msg(
            f"the server's kernel may send ICMP redirects, by {arg(join(', ', state.redirects))}: members could bypass "
            "the server"
        )


def _service_drift(state: ServerState) -> Iterator[str]:
    if state.active is False:
        yield msg(
            f"the server is not running: {arg(server.SERVICE)} is {arg(state.unit['ActiveState'])} "
            f"({arg(state.unit.get('SubState', ''))})"
        )
    elif not state.is_live:
        yield msg(f"the server cannot report who is connected: {arg(state.why)}")
    if abs(state.clock_ahead_s) > _CLOCK_S:
        ahead_s = state.clock_ahead_s
        yield msg(
            f"the server's clock is {arg(abs(ahead_s)):.0f} s {'ahead of' if ahead_s > 0 else 'behind'} this computer's"
        )


def _sha256(file: File) -> str:
    return hashlib.sha256(file.content.encode()).hexdigest()
