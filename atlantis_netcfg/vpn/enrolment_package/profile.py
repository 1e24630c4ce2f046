"""A member's complete `.ovpn` profile, and an identity as text. Neither contains data of other members.

An identity consists of machine-readable comment lines and OpenVPN's own inline blocks:

    # atlantis-identity 1
    # name: inesc-laptop1
    # …
    <ca> … </ca>   <cert> … </cert>   <key> … </key>   <tls-crypt-v2> … </tls-crypt-v2>

A profile has the same lines and blocks among its options, so it can be read like an identity file. A line is never
longer than 255 characters: OpenVPN 2.4 treats the rest as another line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from cryptography import x509
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat, load_pem_private_key

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import Transport, VpnServer
from atlantis_netcfg.routeros.render import environment
from atlantis_netcfg.vpn.identity import (
    RENEGOTIATION_S,
    Certificate,
    CertificateStatus,
    Identity,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    Wrap,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Inventory


_MARK = "# atlantis-identity 1"
_NONE = "-"
_KEYS = ("name", "kind", "partner", "device", "address", "link", "vehicle", "common-name", "wrap", "key")
_MAX = 64 * 1024
"""Maximum characters; an RSA profile has 7,000."""
_HEADER_LINE = re.compile(r"# ([a-z-]+): (\S+)")


class NotAnIdentity(UsageError):
    """The text is not an identity of ours, or is incomplete."""

    def __init__(self, what: str) -> None:
        super().__init__(
            msg(f"not a VPN identity: {arg(what)}"), hint="ask the control centre for a new enrolment package"
        )


def identity_file(identity: Identity) -> Secret:
    """Return the identity file for the client role of a host in the inventory; `read_identity` reads it."""
    return Secret(f"{header(identity)}\n{inline(identity).reveal()}\n")


def inline(identity: Identity) -> Secret:
    """Return OpenVPN's inline blocks, without a final newline."""
    wrap = str(identity.certificate.wrap)
    result = (("ca", identity.ca), ("cert", identity.cert), ("key", identity.key.reveal()))
    blocks = (*result, (wrap, identity.wrap_key.reveal()))
    return Secret("\n".join(f"<{name}>\n{text.strip()}\n</{name}>" for name, text in blocks))


def header(identity: Identity) -> str:
    """Return the machine-readable lines, without secrets."""
    member, certificate = identity.member, identity.certificate
    values = (
        *(member.name, member.kind, member.partner or _NONE, member.device, member.address, member.link),
        *(member.vehicle or _NONE, certificate.common_name, certificate.wrap, certificate.key),
    )
    return "\n".join([_MARK, *(f"# {key}: {value}" for key, value in zip(_KEYS, values, strict=True))])


def read_identity(text: str) -> Identity:
    """Parse an identity file or a profile. Raises NotAnIdentity unless all its parts belong together."""
    if len(text) > _MAX:
        raise NotAnIdentity(msg(f"it has more than {arg(_MAX)} characters"))
    values = _header_values(text.replace("\r\n", "\n"))
    try:
        return _identity(values, {name: _block(text, name) for name in ("ca", "cert", "key", values["wrap"])})
    except ValueError as error:
        # `from None`: a parser's words about a key are not shown to anybody.
        raise NotAnIdentity(str(error) if isinstance(error, _Misfit) else "it contains an invalid value") from None


class _Misfit(ValueError):
    """Parts of one identity that do not belong together."""


def _header_values(text: str) -> dict[str, str]:
    lines = text.split("\n")
    if lines.count(_MARK) != 1:
        raise NotAnIdentity(msg(f"the line `{arg(_MARK)}` is missing"))
    start = lines.index(_MARK) + 1
    matches = [_HEADER_LINE.fullmatch(line) for line in lines[start : start + len(_KEYS)]]
    values = {item[1]: item[2] for item in matches if item}
    if tuple(values) != _KEYS:
        raise NotAnIdentity("its header is incomplete")
    if values["wrap"] not in set(Wrap):
        raise NotAnIdentity("the protection of its control channel is unknown")
    return values


def _block(text: str, name: str) -> str:
    blocks = re.findall(rf"^<{name}>\n(.*?)\n</{name}>$", text.replace("\r\n", "\n"), re.DOTALL | re.MULTILINE)
    if len(blocks) != 1:
        raise NotAnIdentity(msg(f"it contains the block <{arg(name)}> {arg(len(blocks))} times"))
    return f"{blocks[0]}\n"


def _identity(values: Mapping[str, str], blocks: Mapping[str, str]) -> Identity:
    certificate = _certificate(values, blocks)
    member = Member(
        name=values["name"],
        kind=MemberKind(values["kind"]),
        partner=_optional_value(values["partner"]),
        device=values["device"],
        address=IPv4Address(values["address"]),
        link=MemberLink(values["link"]),
        vehicle=_optional_value(values["vehicle"]),
        certificates=(certificate,),
    )
    return Identity(
        member=member,
        certificate=certificate,
        ca=blocks["ca"],
        cert=blocks["cert"],
        key=Secret(blocks["key"]),
        wrap_key=Secret(blocks[values["wrap"]]),
    )


def _optional_value(value: str) -> str | None:
    return None if value == _NONE else value


def _certificate(values: Mapping[str, str], blocks: Mapping[str, str]) -> Certificate:
    certificate = x509.load_pem_x509_certificate(blocks["cert"].encode())
    _fit(certificate, values, blocks)
    return Certificate(
        common_name=values["common-name"],
        serial=certificate.serial_number,
        sha256=certificate.fingerprint(SHA256()).hex(),
        not_before=certificate.not_valid_before_utc.astimezone(UTC),
        not_after=certificate.not_valid_after_utc.astimezone(UTC),
        wrap=Wrap(values["wrap"]),
        key=KeyType(values["key"]),
        standing=CertificateStatus.ISSUED,
    )


def _fit(certificate: x509.Certificate, values: Mapping[str, str], blocks: Mapping[str, str]) -> None:
    """Raise _Misfit for a key of another certificate, or a certificate of another name or CA."""
    names = [
        str(name_attribute.value)
        for name_attribute in certificate.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    ]
    if names != [values["common-name"]] or values["common-name"].partition(".")[0] != values["name"]:
        raise _Misfit("the name in its certificate differs from the one in its header")
    key = load_pem_private_key(blocks["key"].encode(), password=None)
    form = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    if key.public_key().public_bytes(*form) != certificate.public_key().public_bytes(*form):
        raise _Misfit("its key does not match its certificate")
    try:
        certificate.verify_directly_issued_by(x509.load_pem_x509_certificate(blocks["ca"].encode()))
    except Exception as error:
        raise _Misfit("its certificate was issued by another CA") from error


_RETRY_MAX_S = {MemberLink.FIBRE: 300, MemberLink.LTE: 300, MemberLink.SATELLITE: 900}
"""Longest pause of `connect-retry`: a refused attempt costs 12 kB, more than a healthy device's day (facts 9)."""
_UNATTENDED_KINDS = frozenset({MemberKind.ROBOT, MemberKind.ROUTER, MemberKind.HOST})


@dataclass(frozen=True, slots=True)
class _OvpnView:
    """Data of the profile template.

    `tun-mtu` is not included: both ends have to agree, OpenVPN below 2.6 and RouterOS do not accept it from the server,
    the pilot's DDS messages are small enough for every link (facts 9), and `mssfix` handles TCP.
    """

    title: str
    header: str
    proto: str
    remote: IPv4Address
    port: int
    dev: str
    server: str
    old_words: bool
    is_unattended: bool
    retry_max_s: int
    slow: bool
    blocks: Secret
    renegotiation_s: int = RENEGOTIATION_S


def profile(inventory: Inventory, identity: Identity) -> Secret:
    """Return a member's `.ovpn` text, for OpenVPN 2.5 and later.

    A shared tls-crypt key (`certificate.wrap`) is issued to clients that support nothing else, such as OpenVPN 2.4;
    then the profile uses only options that 2.4 supports. Nothing else selects between the two.
    """
    template = environment().get_template("handout/profile.ovpn.j2")
    return Secret(template.render(view=_view(inventory, identity)))


def server_name(inventory: Inventory) -> str:
    """Return the common name of the server's certificate, required by every profile: its inventory host name."""
    return inventory.pilot.vpn.server


def is_declared(member: Member) -> bool:
    """Return True for a host of the inventory: a role installs its identity, nobody does it by hand."""
    return member.kind is MemberKind.HOST or (member.kind is MemberKind.ROUTER and member.partner is None)


def remote(inventory: Inventory, member: Member) -> IPv4Address:
    """Return the server's address for a member: the public one, or its LAN address at the server's own site."""
    vpn = inventory.pilot.vpn
    server, host = inventory.hosts[vpn.server], inventory.hosts.get(member.name)
    beside = is_declared(member) and host is not None and host.site == server.site
    return server.device.address if beside and isinstance(server.device, VpnServer) else vpn.endpoint


def day(identity: Identity) -> str:
    """Return the certificate's last fully valid day, in UTC."""
    return f"{identity.certificate.not_after:%Y-%m-%d}"


def _view(inventory: Inventory, identity: Identity) -> _OvpnView:
    vpn, member = inventory.pilot.vpn, identity.member
    return _OvpnView(
        title=msg(
            f"VPN of {arg(inventory.pilot.name)}: {arg(member.name)}, address {arg(member.address)}, until "
            f"{arg(day(identity))}."
        ),
        header=header(identity),
        proto="udp4" if vpn.transport is Transport.UDP else "tcp4-client",
        remote=remote(inventory, member),
        port=vpn.port,
        dev="tun0" if member.kind is MemberKind.HOST else "tun",
        server=server_name(inventory),
        old_words=identity.certificate.wrap is Wrap.TLS_CRYPT,
        is_unattended=member.kind in _UNATTENDED_KINDS,
        retry_max_s=_RETRY_MAX_S[member.link],
        slow=member.link is MemberLink.SATELLITE,
        blocks=inline(identity),
    )
