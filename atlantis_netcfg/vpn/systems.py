"""System, ROS 2 release and OpenVPN of a partner's device, and the key (`wrap`) that its OpenVPN supports.

OpenVPN 2.4 does not support tls-crypt-v2 and refuses such a profile (facts 10). Ubuntu 20.04, and with it ROS 2 Foxy,
has 2.4; the table below has the version that each Ubuntu ships.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.inventory import model
from atlantis_netcfg.vpn import identity

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Host, Inventory


UBUNTU: Mapping[model.RosDistribution, tuple[str, model.OpenVpnVersion]] = {
    model.RosDistribution.FOXY: ("20.04", model.OpenVpnVersion.V2_4),
    model.RosDistribution.HUMBLE: ("22.04", model.OpenVpnVersion.V2_5),
    model.RosDistribution.JAZZY: ("24.04", model.OpenVpnVersion.V2_6),
}
"""Ubuntu version for each ROS 2 release (REP 2000), with the OpenVPN in its archive."""


def system_of(member: identity.Member) -> identity.ClientSystem | None:
    """Return the system that runs a member's tunnel: as given, or the only one of its kind; None if unknown."""
    possible = identity.SYSTEMS[member.kind]
    return possible[0] if len(possible) == 1 else member.system


def distribution(
    inventory: Inventory, vehicle: str | None, onboarding_release: model.RosDistribution | None = None
) -> model.RosDistribution | None:
    """Return the ROS 2 release of a device: from the vehicle, else from the enrolment, else from the pilot."""
    vehicle_config = inventory.vehicles.get(vehicle or "")
    pilot = inventory.pilot.dds.distribution if inventory.pilot.dds is not None else None
    return (vehicle_config.distribution if vehicle_config is not None else None) or onboarding_release or pilot


def openvpn(
    inventory: Inventory,
    kind: identity.MemberKind,
    vehicle: str | None,
    *,
    version: model.OpenVpnVersion | None = None,
    release: model.RosDistribution | None = None,
) -> model.OpenVpnVersion | None:
    """Return the OpenVPN version of a partner's device; None if unknown, which counts as 2.5 or later.

    `version` and `release` are command arguments. A version has precedence over one derived from a ROS 2 release, and
    the vehicle over the pilot.
    """
    if kind is not identity.MemberKind.ROBOT:
        return version or (UBUNTU[release][1] if release is not None else None)
    vehicle_config = inventory.vehicles.get(vehicle or "")
    if vehicle_config is not None and vehicle_config.openvpn is not None:
        return vehicle_config.openvpn
    if version is not None:
        return version
    chosen_release = (vehicle_config.distribution if vehicle_config is not None else None) or release
    if chosen_release is None and inventory.pilot.vpn.robot_openvpn is not None:
        return inventory.pilot.vpn.robot_openvpn
    effective_release = chosen_release or distribution(inventory, vehicle)
    return UBUNTU[effective_release][1] if effective_release is not None else None


_WITH_COOKIES = frozenset({model.OpenVpnVersion.V2_6, model.OpenVpnVersion.V2_7})


def wrap_for(version: model.OpenVpnVersion | None, *, force_cookie: bool = False) -> identity.Wrap:
    """Return the best key type with which the server accepts a client of this version.

    Only OpenVPN from 2.6 on answers the cookie that a server may require (`force-cookie`, openvpn(8)); 2.5 was seen to
    get no reply, and for RouterOS it is unknown.
    """
    if force_cookie:
        return identity.Wrap.TLS_CRYPT_V2 if version in _WITH_COOKIES else identity.Wrap.TLS_CRYPT
    return identity.Wrap.TLS_CRYPT if version is model.OpenVpnVersion.V2_4 else identity.Wrap.TLS_CRYPT_V2


def wrap_of_host(inventory: Inventory, host: Host) -> identity.Wrap:
    """Return the best key type for our own host: a gateway's Ubuntu 20.04 has OpenVPN 2.4 (facts 10)."""
    version = model.OpenVpnVersion.V2_4 if isinstance(host.device, model.Gateway) else None
    return wrap_for(version, force_cookie=inventory.pilot.vpn.force_cookie)


def wrap_of(inventory: Inventory, member: identity.Member) -> identity.Wrap:
    """Return the best key type for a member, as far as its OpenVPN is known."""
    host = inventory.hosts.get(member.name) if member.partner is None else None
    if host is not None:
        return wrap_of_host(inventory, host)
    version = openvpn(inventory, member.kind, member.vehicle, release=member.distribution)
    return wrap_for(version, force_cookie=inventory.pilot.vpn.force_cookie)
