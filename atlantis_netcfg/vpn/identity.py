"""Members of the VPN: each has a fixed address and one certificate, or two while it is renewed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime
    from ipaddress import IPv4Address

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory.model import RosDistribution


class MemberKind(StrEnum):
    """Kind of a member; `host` is an inventory computer of a site, the others are partners' devices or site routers."""

    ROBOT = "robot"
    LAPTOP = "laptop"
    ROUTER = "router"
    HOST = "host"


class ClientSystem(StrEnum):
    """System that runs the tunnel; decides which steps and which test an enrolment package contains."""

    LINUX = "linux"
    UBUNTU_DESKTOP = "ubuntu-desktop"
    WINDOWS = "windows"
    MACOS = "macos"
    ANDROID = "android"
    IOS = "ios"
    ROUTEROS = "routeros"


SYSTEMS: Mapping[MemberKind, tuple[ClientSystem, ...]] = {
    MemberKind.ROBOT: (ClientSystem.LINUX,),
    MemberKind.LAPTOP: (
        ClientSystem.LINUX,
        ClientSystem.UBUNTU_DESKTOP,
        ClientSystem.WINDOWS,
        ClientSystem.MACOS,
        ClientSystem.ANDROID,
        ClientSystem.IOS,
    ),
    MemberKind.ROUTER: (ClientSystem.ROUTEROS,),
    MemberKind.HOST: (),
}
"""Systems permitted for each kind of member; with a single choice it may be omitted."""


class MemberLink(StrEnum):
    """The slowest link of a member's tunnel, which sets its timers."""

    FIBRE = "fibre"
    LTE = "4g"
    SATELLITE = "satellite"


TIMERS: Mapping[MemberLink, tuple[int, int]] = {
    MemberLink.FIBRE: (10, 60),
    MemberLink.LTE: (25, 120),
    MemberLink.SATELLITE: (170, 600),
}
"""`ping` and `ping-restart` in seconds. Satellite: 69 kB a day, and RouterOS drops a silent UDP stream after 180 s.

4G [inferred]: mobile networks drop a silent UDP flow after half a minute.
"""
RENEGOTIATION_S = 24 * 3600
"""Interval of new session keys: `reneg-sec` of the server and of each member that supports it. A revoked member is

disconnected at once through the server's management interface, which does not wait for new keys (facts 5).
"""
ROUTEROS_RENEGOTIATION_S = 3600
"""RouterOS has no such option: it is assumed to use OpenVPN's default."""


class Wrap(StrEnum):
    """Protection of the control channel; the shared key is for clients that do not support the other."""

    TLS_CRYPT_V2 = "tls-crypt-v2"
    TLS_CRYPT = "tls-crypt"


class KeyType(StrEnum):
    """Kind of a member's key; RSA for clients that were never seen to work with elliptic curves."""

    EC = "ec"
    RSA = "rsa"


class CertificateStatus(StrEnum):
    """The status of a certificate."""

    ISSUED = "issued"
    """Valid, and not yet seen in use."""
    SEEN = "seen"
    """Valid, and seen by the server."""
    SUPERSEDED = "superseded"
    """Its successor was seen: the server no longer accepts it, and the next list will contain it."""
    REVOKED = "revoked"


@dataclass(frozen=True, slots=True)
class Certificate:
    """One certificate of a member."""

    common_name: str
    """Member name, plus `.2`, `.3`, … for successors: each has its own file at the server and its own sightings."""
    serial: int
    sha256: str
    """SHA-256 of the DER form, hex."""
    not_before: datetime
    not_after: datetime
    wrap: Wrap
    key: KeyType
    standing: CertificateStatus
    seen: datetime | None = None
    """Last time when the server had a session of this certificate; None: never."""
    revoked: datetime | None = None
    reason: str = ""

    @property
    def good(self) -> bool:
        """True if the server accepts it, apart from its dates."""
        return self.standing in {CertificateStatus.ISSUED, CertificateStatus.SEEN}


@dataclass(frozen=True, slots=True)
class Member:
    """One device, from its enrolment on; it is kept for ever, so that its name is never reused."""

    name: str
    """`PARTNER-DEVICE`, or the name of a declared host."""
    kind: MemberKind
    partner: str | None
    """Key in the inventory; None: the pilot's own member."""
    device: str
    address: IPv4Address
    link: MemberLink
    vehicle: str | None
    """Inventory key of this robot; None: not a declared robot."""
    certificates: tuple[Certificate, ...]
    """Oldest first."""
    system: ClientSystem | None = None
    """System that runs the tunnel; None: unknown."""
    distribution: RosDistribution | None = None
    """ROS 2 release given at onboarding; the inventory's value for the vehicle takes precedence."""

    @property
    def good(self) -> tuple[Certificate, ...]:
        """The certificates that the server accepts, apart from their dates."""
        return tuple(certificate for certificate in self.certificates if certificate.good)


@dataclass(frozen=True, slots=True)
class MembershipList:
    """The members according to the ledger."""

    members: Mapping[str, Member]
    """Members by name, in order of onboarding."""
    crl_number: int
    crl_sha256: str
    """SHA-256 of the last published list."""
    crl_next_update: datetime
    queued_names: tuple[str, ...]
    """Revoked common names that the server has not yet confirmed as disconnected."""

    def certificates(self) -> Iterator[tuple[Member, Certificate]]:
        """Yield every certificate with its member."""
        for member in self.members.values():
            for certificate in member.certificates:
                yield member, certificate


@dataclass(frozen=True, slots=True)
class Identity:
    """A member's key and certificates: in memory until delivery, which alone writes them."""

    member: Member
    certificate: Certificate
    ca: str
    """Certificate of the CA; PEM, like all of these."""
    cert: str
    key: Secret
    """Private key, PKCS #8, not encrypted."""
    wrap_key: Secret
    """tls-crypt-v2 client key, or the shared tls-crypt key, according to `certificate.wrap`."""
