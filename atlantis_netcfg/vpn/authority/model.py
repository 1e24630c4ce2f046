"""What is requested of the authority, what it answers, and what can go wrong with its folder."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, UsageError
from atlantis_netcfg.vpn.identity import KeyType, Link, Wrap

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address, IPv4Network

    from atlantis_netcfg.vpn.identity import Certificate, Kind, Member


CLIENT_DAYS = 397
"""A year, and a month to renew in."""


@dataclass(frozen=True, slots=True)
class ServerNames:
    """What the server's certificate is made out to; clients compare it with what they connect to."""

    common_name: str
    dns: tuple[str, ...]
    addresses: tuple[IPv4Address, ...]


@dataclass(frozen=True, slots=True)
class EnrolmentRequest:
    """A request to make a device a member."""

    name: str
    """`names.member_name(partner, device)`, or the name of a declared host (then `partner` is None)."""
    kind: Kind
    partner: str | None
    device: str
    address: IPv4Address | None = None
    """Declared address; None: the next free one of `pool`."""
    pool: IPv4Network | None = None
    """Where the address must lie."""
    link: Link = Link.FIBRE
    vehicle: str | None = None
    wrap: Wrap = Wrap.TLS_CRYPT_V2
    key: KeyType = KeyType.EC
    days: int = CLIENT_DAYS
    """How long the certificate is good for."""
    request_id: str = ""
    """Recorded beside the certificate: whose request it answers."""


@dataclass(frozen=True, slots=True)
class RenewalRequest:
    """What a renewal changes; None: as the newest certificate has it."""

    days: int | None = None
    """How long the successor is good for; None: a year and a month."""
    wrap: Wrap | None = None
    key: KeyType | None = None
    link: Link | None = None
    request_id: str = ""


@dataclass(frozen=True, slots=True)
class HandoutFile:
    """The one file that a member gets: it is on disk, whole, mode 0600."""

    path: str
    sha256: str


@dataclass(frozen=True, slots=True)
class IssueResult:
    """A member with its newest certificate."""

    member: Member
    certificate: Certificate
    delivered: HandoutFile
    already: bool = False
    """It was so before: nothing new was made."""
    replaced: tuple[str, ...] = ()
    """Common names that this one takes the place of, revoked because they were never seen in use."""


@dataclass(frozen=True, slots=True)
class RevocationResult:
    """What must be dead now."""

    common_names: tuple[str, ...]
    """Every certificate of these members that was ever handed out: no session of any of them may live."""
    members: tuple[str, ...]
    crl: bytes
    """The published list, PEM."""
    already: tuple[str, ...] = ()
    """Those of `members` that had been revoked before."""


@dataclass(frozen=True, slots=True)
class SessionObservation:
    """What the server's sessions mean for the record."""

    superseded: tuple[str, ...]
    """Common names that are admitted no more from now on, because a successor was seen."""
    strangers: tuple[str, ...]
    """Common names that are not in the record."""
    withdrawn: tuple[str, ...]
    """Common names that were seen after they were revoked or superseded."""


class NoAuthority(UsageError):
    """There is no authority in the folder."""


class NoSuchMember(UsageError, LookupError):
    """There is no member of this name."""


class OtherMember(UsageError):
    """A member of this name exists and differs from the request."""


class AddressTaken(UsageError):
    """The address is in use, or cannot be given to a member."""


class PoolFull(UsageError):
    """Every address of the pool is in use."""


class AuthorityBusy(NetcfgError):
    """Somebody else works on the authority, and did not end in time. Nothing was changed."""

    exit = ExitCode.FAILED


class AuthorityFailed(NetcfgError):
    """A file could not be written: what is recorded stands, and the same command again goes on from there."""

    exit = ExitCode.FAILED


class AuthorityDamaged(NetcfgError):
    """The folder is not what its record says: nothing is signed before a person has looked."""

    exit = ExitCode.FAILED


class ClockBehind(NetcfgError):
    """This computer's clock stands before the last record: what it would sign might not be valid, or end too early."""

    exit = ExitCode.FAILED


@contextmanager
def os_errors_as(what: str) -> Iterator[None]:
    """Turn an OSError into AuthorityFailed, with a message for a person."""
    try:
        yield
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        raise AuthorityFailed(
            f"{what}: {error.strerror or error}{where}",
            hint="make room on the disk or correct its permissions, then run the same command again",
        ) from error
