"""The shipped pilot with two partners' devices: one robot that the other partner sees, and one that it does not."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from ipaddress import IPv4Address
from pathlib import Path

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Transport, VpnService
from atlantis_netcfg.vpn.identity import (
    Certificate,
    CertificateStatus,
    KeyType,
    Member,
    MemberKind,
    MemberLink,
    MembershipList,
    Wrap,
)

SHIPPED = Path(__file__).parents[4] / "inventory"
_NOW = datetime(2026, 6, 1, tzinfo=UTC)
ROUTER, GATEWAY, CENTRE = "coastal-router", "coastal-gateway", "scc-control"
MINE = VpnService(name='a "name" #\u20ac', host="scc-vpn", port=8080)
"""Of the server itself, and called as nobody should call a service."""
TIME = VpnService(name="time", host="coastal-gateway", transport=Transport.UDP, port=123)


@cache
def shipped() -> Inventory:
    return load(SHIPPED)


def pilot(sees: Mapping[str, tuple[str, ...]] | None = None, services: Iterable[VpnService] = ()) -> Inventory:
    """`services` come on top of the shipped one."""
    declaration = shipped()
    partners = {name: declaration.partners[name] for name in ("inesc", "iqua")}
    for name, seen in (sees or {}).items():
        partners[name] = partners[name].model_copy(update={"sees": seen})
    vpn = declaration.pilot.vpn.model_copy(update={"services": (*declaration.pilot.vpn.services, *services)})
    return replace(declaration, partners=partners, pilot=declaration.pilot.model_copy(update={"vpn": vpn}))


def member(  # noqa: PLR0913 - what a member is
    name: str,
    address: str,
    *,
    kind: MemberKind = MemberKind.HOST,
    partner: str | None = None,
    vehicle: str | None = None,
    standing: CertificateStatus = CertificateStatus.ISSUED,
) -> Member:
    certificate = Certificate(
        common_name=name,
        serial=1,
        sha256="00",
        not_before=_NOW,
        not_after=_NOW,
        wrap=Wrap.TLS_CRYPT_V2,
        key=KeyType.EC,
        standing=standing,
    )
    return Member(
        name=name,
        kind=kind,
        partner=partner,
        device=name,
        address=IPv4Address(address),
        link=MemberLink.FIBRE,
        vehicle=vehicle,
        certificates=(certificate,),
    )


def membership(*members: Member) -> MembershipList:
    return MembershipList({one.name: one for one in members}, 1, "", _NOW, ())


MEMBERS = (
    member(ROUTER, "10.80.0.11"),
    member(GATEWAY, "10.80.0.21"),
    member(CENTRE, "10.80.0.2"),
    member("own-laptop", "10.80.0.60", kind=MemberKind.LAPTOP),
    member("own-mares", "10.80.0.61", kind=MemberKind.ROBOT, vehicle="mares"),
    member("inesc-laptop", "10.80.16.1", kind=MemberKind.LAPTOP, partner="inesc"),
    member("inesc-zarco", "10.80.16.2", kind=MemberKind.ROBOT, partner="inesc", vehicle="zarco"),
    member("iqua-laptop", "10.80.17.1", kind=MemberKind.LAPTOP, partner="iqua"),
    member("iqua-sparus", "10.80.17.2", kind=MemberKind.ROBOT, partner="iqua", vehicle="sparus"),
    member("iqua-lost", "10.80.17.3", kind=MemberKind.LAPTOP, partner="iqua", standing=CertificateStatus.REVOKED),
    member("gone-laptop", "10.80.30.1", kind=MemberKind.LAPTOP, partner="gone"),
)
"""The last two are nobody: revoked, and of a partner that is declared no more."""
