"""The gateway of a rehearsal when all is well: what its programs would print, from the declaration."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import Gateway, VpnServer, WifiRole
from atlantis_netcfg.emulator.linux import (
    AddressSpec,
    AssociationSpec,
    CertificateSpec,
    ComputerSpec,
    DdsSpec,
    EchoSpec,
    InterfaceSpec,
    UdpSpec,
    lan_computer,
)
from atlantis_netcfg.gateway.network import gateway_network
from atlantis_netcfg.vpn.client import IDENTITY

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import WifiEndpoint

_OUTDOORS_MHZ = 5500
"""Where CEPT admits outdoor antennas."""
_OF_THE_IMAGE = "/etc/netplan/10-atlantis.yaml"
ROUTER_MAC = "02:00:5E:00:FF:01"
"""Of the router's port in the LAN, as the emulated computer sees it; no address of a real device."""


def gateway_computer(declaration: Declaration, host: Host, vehicles: tuple[str, ...]) -> ComputerSpec:
    """Describe the gateway `host` with these vehicles around it."""
    device, lan = host.device, declaration.sites[host.site].lan
    assert isinstance(device, Gateway)  # noqa: S101 - the caller has looked
    reserved = {reservation.name: reservation for reservation in lan.reservations}
    server = declaration.hosts[declaration.pilot.vpn.server].device
    computer = lan_computer(
        host.name,
        address=f"{device.address}/{lan.network.prefixlen}",
        mac=device.mac,
        router=(str(lan.gateway), ROUTER_MAC),
        others={str(reserved[key].address): reserved[key].mac for key in vehicles if key in reserved},
        tunnel=f"{device.vpn_address}/32" if device.vpn_address is not None else None,
        server=str(server.vpn_address) if isinstance(server, VpnServer) else None,
    )
    radios = tuple(_radios(declaration, vehicles))
    return computer.model_copy(
        update={
            "interfaces": (*computer.interfaces, *radios),
            "files": {**computer.files, **_network(declaration, host)},
            "udp": tuple(_participants(declaration)),
            "dds": tuple(_answering(declaration, device)),
            "certificates": _identity(host),
            "echoes": {**computer.echoes, **dict.fromkeys(_behind(declaration, vehicles), EchoSpec(rtt_ms=2.4))},
        }
    )


def _network(declaration: Declaration, host: Host) -> dict[str, str]:
    """Give the file from which the computer gets its address at the next start: that of the role, or of its image."""
    promised = gateway_network(declaration, host)
    if promised is not None:
        return {promised.path: promised.content}
    assert isinstance(host.device, Gateway)  # noqa: S101 - the caller has looked
    prefix = declaration.sites[host.site].lan.network.prefixlen
    address = f"{host.device.address}/{prefix}"
    return {_OF_THE_IMAGE: f"network: {{version: 2, ethernets: {{eth0: {{addresses: [{address}]}}}}}}\n"}


def _participants(declaration: Declaration) -> Iterator[UdpSpec]:
    """One ROS process with its profile: the two ports of its domain and of its number in it (DDSI-RTPS 9.6.2.3)."""
    if declaration.pilot.dds is not None:
        first = 7400 + 250 * declaration.pilot.dds.domain
        yield from (UdpSpec(port=first + offset) for offset in (10, 11))


def _answering(declaration: Declaration, device: Gateway) -> Iterator[DdsSpec]:
    """The same process, which says that it is reached where the others of the pilot look for it."""
    dds = declaration.pilot.dds
    if dds is not None:
        yield DdsSpec(domain=dds.domain, addresses=(dds.address_of(device),))


def _identity(host: Host) -> dict[str, tuple[CertificateSpec, ...]]:
    assert isinstance(host.device, Gateway)  # noqa: S101 - the caller has looked
    if host.device.vpn_address is None:
        return {}
    certificate = CertificateSpec(subject=host.name, not_after=datetime.now(UTC) + timedelta(days=300))
    return {IDENTITY: (certificate, CertificateSpec(subject=certificate.issuer))}


def _access_points(declaration: Declaration, vehicles: tuple[str, ...]) -> Iterator[WifiEndpoint]:
    for key in vehicles:
        wifi = declaration.vehicles[key].endpoints.wifi
        if wifi is not None and wifi.role is WifiRole.ACCESS_POINT:
            yield wifi


def _behind(declaration: Declaration, vehicles: tuple[str, ...]) -> Iterator[str]:
    return (str(wifi.address) for wifi in _access_points(declaration, vehicles) if wifi.address is not None)


def _radios(declaration: Declaration, vehicles: tuple[str, ...]) -> Iterator[InterfaceSpec]:
    """One radio for each access point, each in the network of its robot."""
    seen: set[str] = set()
    for number, wifi in enumerate(_access_points(declaration, vehicles), start=1):
        if wifi.interface in seen:
            continue
        seen.add(wifi.interface)
        local = None if wifi.address is None else f"{wifi.address + 100}/24"
        yield InterfaceSpec(
            name=wifi.interface,
            mac=f"02:00:5E:00:FE:{number:02X}",
            addresses=() if local is None else (AddressSpec(address=local, lease_s=3000),),
            wireless=True,
            association=AssociationSpec(
                ssid=wifi.ssid or "EXAMPLE",
                bssid=wifi.mac or f"02:00:5E:00:FD:{number:02X}",
                frequency_mhz=_OUTDOORS_MHZ,
            ),
        )
