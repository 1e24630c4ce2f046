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
"""What each kind of member may run. Where there is no choice it need not be said."""


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
"""`ping` and `ping-restart` in seconds. Satellite: 69 kB a day, and RouterOS forgets a silent UDP stream after 180 s;
4G [inferred]: mobile networks forget a silent UDP flow after half a minute."""
RENEGOTIATION_S = 24 * 3600
"""A session gets new keys so often: `reneg-sec` of the server and of each member that takes it. Whoever is revoked is
cut at once by the server's management interface, which does not wait for new keys (facts 5)."""
ROUTEROS_RENEGOTIATION_S = 3600
"""RouterOS has no such option: it is taken to do as OpenVPN does by default."""


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
    """Good, and not yet seen in use."""
    SEEN = "seen"
    """Good, and the server has seen it."""
    SUPERSEDED = "superseded"
    """Its successor was seen: the server admits it no more, and the next list will hold it."""
    REVOKED = "revoked"


@dataclass(frozen=True, slots=True)
class Certificate:
    """One certificate of a member."""

    common_name: str
    """The member's name, and for a successor `.2`, `.3`, …: each has its own file at the server, and is seen alone."""
    serial: int
    sha256: str
    """Of its DER form, hex."""
    not_before: datetime
    not_after: datetime
    wrap: Wrap
    key: KeyType
    standing: CertificateStatus
    seen: datetime | None = None
    """Last time that the server was seen to have a session of it."""
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
    """Key in the declaration; None: the pilot's own."""
    device: str
    address: IPv4Address
    link: MemberLink
    vehicle: str | None
    """Key in the declaration of the robot that it is; None: none of them."""
    certificates: tuple[Certificate, ...]
    """Oldest first."""
    system: ClientSystem | None = None
    """What its tunnel is started on; None: nobody has said it."""
    distribution: RosDistribution | None = None
    """Release of ROS 2, as said at onboarding; what the declaration says of its vehicle counts more."""

    @property
    def good(self) -> tuple[Certificate, ...]:
        """The certificates that the server accepts, apart from their dates."""
        return tuple(certificate for certificate in self.certificates if certificate.good)


@dataclass(frozen=True, slots=True)
class MembershipList:
    """The members according to the ledger."""

    members: Mapping[str, Member]
    """By name, in the order of their onboarding."""
    crl_number: int
    crl_sha256: str
    """Of the list that was published last."""
    crl_next_update: datetime
    queued_names: tuple[str, ...]
    """Common names that were revoked, and of which the server has not confirmed that they are dead."""

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
    """PEM, as all of these."""
    cert: str
    key: Secret
    """PKCS #8, not encrypted."""
    wrap_key: Secret
    """tls-crypt-v2 client key, or the shared tls-crypt key, as `certificate.wrap` says."""
