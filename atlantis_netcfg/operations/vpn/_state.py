"""What the running server is, as it has told it."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.operations.vpn.errors import AnswerLost
from atlantis_netcfg.vpn.firewall import ADMITTED, TABLE
from atlantis_netcfg.vpn.server import CCD, FIREWALL, FOLDER, MANAGEMENT, SEEN, SERVICE, STATUS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.operations.vpn.link import ServerLink

__all__ = ["PLACE", "Crl", "ServerState", "Session", "observe", "sessions_of", "understood"]

PLACE: Mapping[str, str] = {
    "ca": f"{FOLDER}/ca.crt",
    "ccd": CCD,
    "crl": f"{FOLDER}/crl.pem",
    "firewall": FIREWALL,
    "table": f"inet {TABLE}",
    "members": ADMITTED,
    "socket": MANAGEMENT,
    "status": STATUS,
    "seen": SEEN,
    "unit": SERVICE,
    "firewall_unit": "atlantis-vpn-firewall.service",
}
"""For every request: where things are on the server."""
_ANSWERS = "answers"


@dataclass(frozen=True, slots=True)
class Session:
    """A session that the server has."""

    common_name: str
    """`UNDEF` as long as no certificate came."""
    real: str
    """Address and port of the client."""
    address: str
    """In the VPN; empty: it is not through its handshake."""
    since: datetime
    received_bytes: int
    sent_bytes: int

    @property
    def is_up(self) -> bool:
        """Whether its client was admitted."""
        return bool(self.address)

    def as_json(self) -> dict[str, Any]:
        """For programs."""
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
    """The list of revoked certificates that the server has."""

    number: int
    begins: datetime
    ends: datetime
    signed: bool
    """By the authority whose certificate the server has."""
    pem: str = ""


@dataclass(frozen=True, slots=True)
class ServerState:
    """All that `provision vpn status` tells of the server."""

    ready: bool
    """The role has set it up."""
    files: Mapping[str, str]
    """Path of each live file that is there to its SHA-256."""
    crl: Crl | None
    """None: there is none, or none that can be read; then nobody can connect."""
    members: tuple[IPv4Network, ...] | None
    """Who passes the firewall; None: it is not loaded, or does not answer."""
    firewall_as_file: bool | None
    """Whether the kernel's firewall is what its file says; None: that cannot be told."""
    firewall_why: str
    redirects: tuple[str, ...]
    """Interfaces by which the server's kernel may tell members of a way past it."""
    version: str | None
    """Of OpenVPN."""
    package: str | None
    """Version of its Debian package."""
    unit: Mapping[str, str]
    """What systemd tells of the server's unit."""
    sessions: tuple[Session, ...]
    asked: bool
    """Whether the sessions are the server's own word of this moment; else they are from its status file."""
    why: str
    """Why it was not asked."""
    at: datetime
    """To when the sessions belong; the server's clock."""
    seen: Mapping[str, datetime]
    """Common name to when it had a session last, as the server's timer has noted it."""
    clock: datetime
    clock_ahead_s: float
    """The server's clock, compared with this computer's."""

    @property
    def active(self) -> bool | None:
        """Whether the server's unit runs; None: systemd does not tell."""
        return self.unit["ActiveState"] == "active" if "ActiveState" in self.unit else None


@contextmanager
def understood(do: str) -> Iterator[None]:
    """Read an answer: what it lacks, or has of another kind, is the server's fault. Raises AnswerLost."""
    try:
        yield
    except (KeyError, IndexError, TypeError, AttributeError, ValueError, OverflowError, OSError) as error:
        raise AnswerLost(
            f"the server's answer to `{do}` makes no sense ({type(error).__name__}: {error})",
            hint="look at that computer and at who else has worked on it, then type the same again",
        ) from error


def observe(link: ServerLink) -> ServerState:
    """Look at the server, in one request. Raises ServerAway, AnswerLost, ServerRefused."""
    began = time.time()
    values = link.ask("look", place=dict(PLACE))
    middle = (began + time.time()) / 2
    with understood("look"):
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
        asked=values["management"] == _ANSWERS,
        why=str(values["why"]),
        at=_moment(values["at"]),
        seen=_seen(values["seen"]),
        clock=_moment(values["clock"]),
        clock_ahead_s=float(values["clock"]) - middle,
    )


def sessions_of(values: Mapping[str, Any]) -> tuple[Session, ...]:
    """The sessions in an answer."""
    return tuple(
        Session(
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


def _seen(noted: Mapping[str, Any] | None) -> dict[str, datetime]:
    rows = (noted or {}).get("seen")
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
