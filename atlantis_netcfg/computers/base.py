"""Part `gateway_base`: the basic configuration of every gateway and control centre.

Locale, host name, time that does not need the VPN, SSH with keys only, a firewall that never locks out its user, a
journal that does not fill the card, the watchdog. Chapters 3, 9 and 11 of the facts; Debian 12, Ubuntu 20.04 to 24.04.

The steps run in the computer's shell, after its files are in place. The templates use `BaseView`: text and numbers, a
pure function of the inventory.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network, collapse_addresses
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.computers import radios
from atlantis_netcfg.computers import services as hosted
from atlantis_netcfg.computers.dds_link import DdsLink, dds_link, dds_link_unit
from atlantis_netcfg.computers.parts import (
    Check,
    Configuration,
    ConvergeStep,
    Directory,
    File,
    NetworkPart,
    Package,
    SshRequirements,
    SymbolicLink,
    Unit,
    computer_network,
)
from atlantis_netcfg.computers.reflector import QUALIFY_SECRET, link_reflector, qualify_settings, reflector
from atlantis_netcfg.computers.retrieval import packages as retrieval_packages
from atlantis_netcfg.computers.retrieval import retrieval
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.inventory import Host, Inventory

CLOUD_INIT = "/etc/cloud/cloud-init.disabled"
"""If this file exists, cloud-init does nothing at boot, unless the file below or the kernel says otherwise."""
CLOUD_INIT_ON = "/etc/cloud/cloud-init.enabled"
HOSTNAME = "/etc/hostname"
LOCALES = "/etc/locale.gen"
SSHD = "/etc/ssh/sshd_config.d/00-atlantis.conf"
SYSCTL = "/etc/sysctl.d/60-atlantis.conf"
WATCHDOG = "/etc/systemd/system.conf.d/atlantis-watchdog.conf"

ACCEPT_CHRONY = (
    "sh",
    "-c",
    'case "$(chronyd -v 2>&1)" in *"version 3"*|*"not found"*) ;; *) exec chronyd -p -f "$1" ;; esac',
    "sh",
    "%s",
)
"""chrony 3.5 of Ubuntu 20.04 cannot check a file; 4.0 and later can."""

_SET_KERNEL = f"""\
while read -r key equals value; do
    case "$key" in ''|'#'*) continue ;; esac
    for place in /proc/sys/$(printf %s "${{key#-}}" | tr . /); do
        [ "$key" = "${{key#-}}" ] || [ -e "$place" ] || continue
        printf %s "$value" > "$place" 2>/dev/null || echo "note: this kernel does not let $key be set to $value"
    done
done < {SYSCTL}
"""
_OBEYS = f"""\
told="$(sshd -T -C user=root,host=localhost,addr=127.0.0.1,laddr=127.0.0.1,lport=22)" || exit 1
case "$told" in *"passwordauthentication no"*) exit 0 ;; esac
echo "sshd does not read {SSHD}: begin /etc/ssh/sshd_config with the line"
echo "Include /etc/ssh/sshd_config.d/*.conf"
exit 1
"""
_SET_WATCHDOG = (
    f"systemctl daemon-reexec || exit 1\nif [ -e {WATCHDOG} ] && ! [ -e /dev/watchdog0 ] && ! [ -e "
    '/dev/watchdog ]; then\n    echo "this board has no watchdog (/dev/watchdog0): load its driver, or '
    'remove watchdog_s from the inventory"\n    exit 1\nfi\n'
)

STEPS = (
    ConvergeStep("generate the locale", ("locale-gen",), (LOCALES,)),
    ConvergeStep("set the host name", ("hostname", "-F", HOSTNAME), (HOSTNAME,)),
    ConvergeStep("set kernel parameters", ("sh", "-c", _SET_KERNEL), (SYSCTL,)),
    ConvergeStep("check that sshd reads its new file", ("sh", "-c", _OBEYS), (SSHD, "/etc/ssh/sshd_config")),
    ConvergeStep("set the watchdog", ("sh", "-c", _SET_WATCHDOG), (WATCHDOG,)),
)

CHECKS = (
    Check(
        ("sh", "-c", "! command -v cloud-init >/dev/null || ! grep -qw cloud-init=enabled /proc/cmdline"),
        "the kernel command line enables cloud-init, which overwrites name, address and accounts",
        "on the computer: remove `cloud-init=enabled` from the kernel command line in its boot loader, then `sudo "
        "reboot`",
    ),
)


@dataclass(frozen=True, slots=True)
class DdsPorts:
    """UDP ports of the pilot's DDS domain: DDSI-RTPS formula 9.6.2.3 with default values."""

    domain: int
    ports: range
    sources: tuple[str, ...]
    """Networks from which they can be reached."""


@dataclass(frozen=True, slots=True)
class OpenPort:
    """Port of a service in the inventory, and the networks that may reach it."""

    name: str
    """Name of the service."""
    transport: model.Transport
    port: int | str
    """A port, or a range of ports as nft(8) writes it."""
    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NeighbourHost:
    """Another computer of the pilot, as an entry of the host list."""

    name: str
    address: str
    domain: str | None
    """Domain of its LAN; None: it is reached over the VPN."""


@dataclass(frozen=True, slots=True)
class AccessPointUplink:
    """Forwarding rule for stations of the gateway's access point: they reach only the VPN server."""

    network: str
    """Network of the stations."""
    server: str
    transport: model.Transport
    port: int


@dataclass(frozen=True, slots=True)
class BaseView:
    """Values that the base templates use for one computer."""

    name: str
    site: str
    domain: str
    time_zone: str
    router: str
    time_servers: tuple[model.TimeServer, ...]
    gps: model.GpsTime | None
    lan: str
    ssh_from: tuple[str, ...]
    ssh_port: int
    dds: DdsPorts | None
    dds_link: DdsLink | None
    """None: DDS uses every link of the site."""
    services: tuple[OpenPort, ...]
    metered_links: tuple[str, ...]
    watchdog_s: int | None
    neighbours: tuple[NeighbourHost, ...]
    interfaces: tuple[str, ...]
    """All interfaces that are declared by name: of the LAN and of the radios."""
    radios: tuple[str, ...]
    """Interfaces in the networks of robots; nothing is forwarded from or to them."""
    access_point_interface: str | None
    """Radio interface that opens a network and gives addresses to its stations."""
    way_out: AccessPointUplink | None
    """None: nothing is forwarded from or to any of the radios."""


def base_view(inventory: Inventory, host: Host) -> BaseView:
    """Build the template values for a host whose base system this toolkit manages."""
    device = host.device
    assert isinstance(device, model.ServerComputer)  # noqa: S101 - `gateway_base` checks it
    site = inventory.sites[host.site]
    lan, vpn = site.lan.network, inventory.pilot.vpn.network
    access_point, air = radios.opened_radio(host), radios.interfaces(inventory, host)
    return BaseView(
        name=host.name,
        site=host.site,
        domain=site.lan.domain,
        time_zone=inventory.pilot.time_zone,
        router=str(site.lan.gateway),
        time_servers=inventory.pilot.time_servers,
        gps=device.gps,
        lan=str(lan),
        ssh_from=_collapse((*site.management.admit, lan, vpn)),
        ssh_port=device.ssh.port,
        dds=_dds(inventory, (lan, vpn)),
        dds_link=dds_link(inventory, host),
        services=tuple(_open_ports(inventory, host.name, device, lan)),
        metered_links=tuple(link.name for link in site.bearers if link.metered),
        watchdog_s=device.watchdog_s,
        neighbours=_neighbours(inventory, host),
        interfaces=(*(() if device.network is None else (device.network.interface,)), *air),
        radios=air,
        access_point_interface=None if access_point is None else access_point.interface,
        way_out=None if access_point is None or not access_point.vpn else _access_point_uplink(inventory, access_point),
    )


def _access_point_uplink(inventory: Inventory, access_point: model.GatewayAccessPoint) -> AccessPointUplink:
    vpn = inventory.pilot.vpn
    return AccessPointUplink(str(access_point.network), str(vpn.endpoint), vpn.transport, vpn.port)


def _dds(inventory: Inventory, near: Iterable[IPv4Network]) -> DdsPorts | None:
    dds = inventory.pilot.dds
    if dds is None:
        return None
    far = [site.lan.network for site in inventory.sites.values()] if dds.over is model.DdsPath.LAN else []
    return DdsPorts(dds.domain, dds.all_ports, _collapse((*near, *far)))


def _open_ports(inventory: Inventory, host: str, device: model.ServerComputer, lan: IPv4Network) -> Iterator[OpenPort]:
    """Yield a host's own services, then its shared partner services, which the VPN server opens as well.

    Then the ports that our computers of other sites read for their checklists, and the ports of vehicle streams.
    """
    vpn = inventory.pilot.vpn
    ours = {model.ServiceNetwork.LAN: lan, model.ServiceNetwork.VPN: vpn.infrastructure}
    for service in device.services:
        pools = (inventory.partners[partner].vpn_pool for partner in service.partners)
        sources = _collapse((*(ours[network] for network in service.open_to), *pools))
        if service.port is not None and sources:
            yield OpenPort(service.name, service.transport, service.port, sources)
    everybody = _collapse((vpn.network, *(site.lan.network for site in inventory.sites.values())))
    for vpn_service in vpn.services:
        if vpn_service.host == host:
            yield OpenPort(vpn_service.name, vpn_service.transport, vpn_service.port, everybody)
    if device.vpn_address is not None:
        yield OpenPort(
            "checklists of other sites", model.Transport.UDP, model.REFLECTOR_PORT, (str(vpn.infrastructure),)
        )
    if (qualify := qualify_settings(host, inventory.pilot)) is not None:
        yield OpenPort("measurements", model.Transport.UDP, qualify.port, ("0.0.0.0/0",))
    if device.ros1_bridge is not None:
        yield OpenPort("ROS 1", model.Transport.TCP, _EPHEMERAL, (f"{device.ros1_bridge.master}/32",))
    yield from _streams(inventory, host, lan)


_EPHEMERAL = "32768-60999"
"""Nodes of ROS 1 listen at ports that the kernel chooses: net.ipv4.ip_local_port_range, Linux default."""


def _streams(inventory: Inventory, host: str, lan: IPv4Network) -> Iterator[OpenPort]:
    """Yield ports for unsolicited streams: the autopilot's MAVLink stream, read by the checklist."""
    site = inventory.hosts[host].site
    computer, vehicle_keys = inventory.computer_of(site), inventory.sites[site].checklist.vehicles
    if computer is None or computer.name != host:
        return
    for key in inventory.vehicles if vehicle_keys is None else vehicle_keys:
        endpoints = inventory.vehicles[key].endpoints
        wifi, stream = endpoints.wifi, endpoints.rc_rf
        if stream is not None and stream.seen_from is model.SeenFrom.GATEWAY:
            wifi_networks = () if wifi is None or wifi.client is None else (wifi.client.network,)
            yield OpenPort(
                msg(f"remote control of {arg(key)}"), model.Transport.UDP, stream.port, _collapse((lan, *wifi_networks))
            )


def _collapse(networks: Iterable[IPv4Network]) -> tuple[str, ...]:
    """Merge networks that contain each other: nft refuses overlapping set elements."""
    return tuple(str(network) for network in collapse_addresses(networks))


def _neighbours(inventory: Inventory, host: Host) -> tuple[NeighbourHost, ...]:
    """List computers of the LAN by LAN address, and gateways and servers of other sites by VPN address."""
    lan = inventory.sites[host.site].lan
    neighbours = {
        reservation.name: NeighbourHost(reservation.name, str(reservation.address), lan.domain)
        for reservation in lan.reservations
    }
    for name, other in inventory.hosts.items():
        address = getattr(other.device, "address", None)
        tunnel = getattr(other.device, "vpn_address", None)
        if other.site == host.site and address is not None and address in lan.network:
            neighbours[name] = NeighbourHost(name, str(address), lan.domain)
        elif other.site != host.site and tunnel is not None:
            neighbours[name] = NeighbourHost(name, str(tunnel), None)
    neighbours.pop(host.name, None)
    return tuple(neighbours.values())


PACKAGES = ("chrony", "fake-hwclock", "iputils-ping", "iw", "locales", "nftables", "openssh-server", "tzdata")
"""fake-hwclock keeps the time over a power cut on boards whose clock has no battery; elsewhere it does nothing.

The pre-test checklist uses iputils-ping and iw to check the radios and cables of a gateway.
"""
LOCALE = "en_US.UTF-8"
"""Locale of the report (4.6.2): ROS 2 needs one with UTF-8."""

_CHRONY = "/etc/chrony/chrony.conf"
_FIREWALL = "/etc/nftables.conf"
_GPS = "/etc/default/gpsd"
_JOURNAL = "/etc/systemd/journald.conf.d/atlantis.conf"
_RESOLVED_CONF = "/etc/systemd/resolved.conf.d/60-atlantis.conf"
"""For systemd-resolved, which not every computer has; elsewhere nothing reads this file."""


@dataclass(frozen=True, slots=True)
class GatewayBase:
    """Desired state that the role `gateway_base` installs and configures."""

    packages: tuple[Package, ...]
    configuration: Configuration
    """Empty: the toolkit manages nothing but its network."""
    network: NetworkPart | None
    """None: the network stays as in the image."""
    secrets: Mapping[str, str]
    """Placeholder in a file -> vehicle whose access point key replaces it."""
    own_secret: str | None
    """Placeholder for the key of the gateway's own access point; None: it has none."""
    service_secrets: tuple[str, ...]
    """Placeholders for the secrets of containers, in the order in which these are declared."""
    qualify_secret: str | None = None
    """Placeholder for the key of the far end of measured links; None: it has none."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's modules."""
        packages = [{"name": package.name, "version": package.version} for package in self.packages]
        network = None if self.network is None else self.network.as_dict()
        parts = {"configure": self.configuration.as_dict(), "network": network}
        values = {"packages": {"packages": packages}, **{name: part for name, part in parts.items() if part}}
        keys = {
            "secrets": dict(self.secrets),
            "own_secret": self.own_secret,
            "service_secrets": list(self.service_secrets),
            "qualify_secret": self.qualify_secret,
        }
        return {**values, **keys} if "configure" in values else values


def gateway_base(
    inventory: Inventory, host: Host, *, is_rehearsal: bool = False, images: Mapping[str, str] | None = None
) -> GatewayBase:
    """Build the desired base system of a host (pure).

    In a rehearsal the network is not managed: it belongs to the machine that runs the rehearsal. `images` (rehearsal
    only): name of a service to the SHA-256 of the archive that replaces its image.
    """
    assert isinstance(host.device, model.SiteComputer)  # noqa: S101 - callers choose computers that are no server of the VPN
    network = None if is_rehearsal else computer_network(inventory, host)
    if not isinstance(host.device, model.ServerComputer):
        return GatewayBase((), Configuration(), network, secrets={}, own_secret=None, service_secrets=())
    view, air = base_view(inventory, host), radios.gateway_radios(inventory, host, is_rehearsal=is_rehearsal)
    absent = (*(() if view.watchdog_s is not None else (WATCHDOG,)), *air.absent)
    more = (*hosted.packages(host.device), *retrieval_packages(inventory, host))
    packages = (*PACKAGES, *(("gpsd",) if view.gps is not None else ()), *more)
    return GatewayBase(
        packages=(*(Package(name) for name in packages), *air.packages),
        configuration=Configuration(
            directories=(Directory(radios.FOLDER, mode="0700"),),
            files=(*_files(view), *air.files),
            links=(SymbolicLink("/etc/localtime", f"/usr/share/zoneinfo/{view.time_zone}"),),
            absent=(CLOUD_INIT_ON, *absent),
            only=(radios.FOLDER,),
            steps=(*STEPS, *air.steps),
            units=(*_units(view), *air.units),
            brought=air.plugged_devices,
            checks=(*CHECKS, *air.checks),
            way_in=SshRequirements(admit=view.ssh_from, port=view.ssh_port, key=True, hint=_admit_hint(view)),
        )
        .merge(reflector(host))
        .merge(dds_link_unit(view.dds_link))
        .merge(link_reflector(host.name, inventory.pilot))
        .merge(hosted.services(host.device, images))
        .merge(retrieval(inventory, host, is_rehearsal=is_rehearsal)),
        network=network,
        secrets=air.secrets,
        own_secret=None if air.access_point is None else air.access_point.placeholder,
        service_secrets=hosted.secret_placeholders(host.device),
        qualify_secret=None if qualify_settings(host.name, inventory.pilot) is None else QUALIFY_SECRET,
    )


def _files(view: BaseView) -> Iterator[File]:
    yield from (
        File(LOCALES, f"{LOCALE} UTF-8\n"),
        File("/etc/default/locale", f"LANG={LOCALE}\n"),
        File(HOSTNAME, f"{view.name}\n"),
        _file(view, "/etc/hosts", "hosts.j2"),
        File("/etc/timezone", f"{view.time_zone}\n"),
        _file(view, _CHRONY, "chrony.conf.j2", ACCEPT_CHRONY),
        _file(view, SSHD, "sshd.conf.j2", ("sshd", "-t", "-f", "%s")),
        _file(view, "/etc/apt/apt.conf.d/90atlantis", "apt.conf.j2", ("apt-config", "-c", "%s", "dump")),
        _file(view, _JOURNAL, "journald.conf.j2"),
        _file(view, SYSCTL, "sysctl.conf.j2"),
        _file(view, _RESOLVED_CONF, "resolved.conf.j2"),
        File(CLOUD_INIT, "# atlantis: name, address and accounts are those of the declaration.\n"),
        File(
            _FIREWALL,
            _text(view, "nftables.conf.j2"),
            validate=("nft", "-c", "-f", "%s"),
            hint=_NO_FIREWALL,
            finding="the firewall of the inventory is not active",
        ),
    )
    if view.watchdog_s is not None:
        yield _file(view, WATCHDOG, "watchdog.conf.j2")
    if view.gps is not None:
        yield _file(view, _GPS, "gpsd.j2")


_NO_FIREWALL = (
    "if the error is `Operation not supported`, the kernel of this computer lacks nf_tables: check with "
    "`nft list ruleset`. Use a newer image from the vendor"
)


def _file(view: BaseView, path: str, template: str, validate: tuple[str, ...] = ()) -> File:
    return File(path, _text(view, template), validate=validate)


def _text(view: BaseView, template: str) -> str:
    return environment().get_template(f"gateway/{template}").render(base=view)


def _units(view: BaseView) -> Iterator[Unit]:
    yield from (
        Unit("systemd-journald.service", after=(_JOURNAL,)),
        Unit("systemd-resolved.service", after=(_RESOLVED_CONF,)),
        Unit("systemd-timesyncd.service", enabled=False, active=False),
        Unit("chrony.service", enabled=True, active=True, after=(_CHRONY,)),
        Unit("nftables.service", enabled=True, active=True, after=(_FIREWALL,), reload=True),
        Unit("ssh.service", after=(SSHD,), reload=True),
    )
    if view.gps is not None:
        yield Unit("gpsd.service", enabled=True, active=True, after=(_GPS,))


def _admit_hint(view: BaseView) -> str:
    return msg(
        f"add the network of your computer to `site.management.admit` in group_vars/{arg(view.site)}.yml, "
        f"or work from the LAN of the site ({arg(view.lan)})"
    )
