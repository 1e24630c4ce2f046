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
    SymbolicLink,
    Unit,
    WayIn,
    computer_network,
)
from atlantis_netcfg.computers.reflector import QUALIFY_SECRET, far_end, measured_at, reflector
from atlantis_netcfg.computers.retrieval import packages as retrieval_packages
from atlantis_netcfg.computers.retrieval import retrieval
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from atlantis_netcfg.inventory import Declaration, Host

CLOUD_INIT = "/etc/cloud/cloud-init.disabled"
"""Where it stands, cloud-init does nothing at a start, unless the file below or the kernel says otherwise."""
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
_SET_WATCHDOG = f"""\
systemctl daemon-reexec || exit 1
if [ -e {WATCHDOG} ] && ! [ -e /dev/watchdog0 ] && ! [ -e /dev/watchdog ]; then
    echo "this board shows no watchdog (/dev/watchdog0): load its driver, or take watchdog_s out of the declaration"
    exit 1
fi
"""

STEPS = (
    ConvergeStep("generate the locale", ("locale-gen",), (LOCALES,)),
    ConvergeStep("set the host name", ("hostname", "-F", HOSTNAME), (HOSTNAME,)),
    ConvergeStep("set values of the kernel", ("sh", "-c", _SET_KERNEL), (SYSCTL,)),
    ConvergeStep("see that sshd reads its new file", ("sh", "-c", _OBEYS), (SSHD, "/etc/ssh/sshd_config")),
    ConvergeStep("set the watchdog", ("sh", "-c", _SET_WATCHDOG), (WATCHDOG,)),
)

CHECKS = (
    Check(
        ("sh", "-c", "! command -v cloud-init >/dev/null || ! grep -qw cloud-init=enabled /proc/cmdline"),
        "cloud-init is switched on by the kernel's command line, and writes name, address and accounts anew",
        "on the computer: take `cloud-init=enabled` out of what its boot loader tells the kernel, then `sudo reboot`",
    ),
)


@dataclass(frozen=True, slots=True)
class DdsPorts:
    """UDP ports of the pilot's DDS domain: DDSI-RTPS formula 9.6.2.3 with default values."""

    domain: int
    ports: range
    sources: tuple[str, ...]
    """From where."""


@dataclass(frozen=True, slots=True)
class OpenPort:
    """Port of a service in the inventory, and the networks that may reach it."""

    name: str
    """Of the service."""
    transport: model.Transport
    port: int | str
    """Or a range of them, as nft(8) writes it."""
    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class DeclaredNeighbour:
    """Another computer of the pilot, as an entry of the host list."""

    name: str
    address: str
    domain: str | None
    """Of its LAN; None where it is reached over the VPN."""


@dataclass(frozen=True, slots=True)
class WayOut:
    """Forwarding rule for stations of the gateway's access point: they reach only the VPN server."""

    network: str
    """Of the stations."""
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
    """None: DDS goes over each link of the site."""
    services: tuple[OpenPort, ...]
    metered_links: tuple[str, ...]
    """Links of the site on which every byte costs."""
    watchdog_s: int | None
    neighbours: tuple[DeclaredNeighbour, ...]
    interfaces: tuple[str, ...]
    """All that are declared by name: of the LAN and of the radios."""
    radios: tuple[str, ...]
    """Interfaces in the networks of robots, from which and to which nothing is forwarded."""
    access_point_interface: str | None
    """The one of them that opens a network, and gives its stations their addresses."""
    way_out: WayOut | None
    """None: nothing is forwarded from or to any of them."""


def base_view(declaration: Declaration, host: Host) -> BaseView:
    """Build the template values for a host whose base system this toolkit manages."""
    device = host.device
    assert isinstance(device, model.ServerComputer)  # noqa: S101 - `gateway_base` has looked
    site = declaration.sites[host.site]
    lan, vpn = site.lan.network, declaration.pilot.vpn.network
    access_point, air = radios.opened_radio(host), radios.interfaces(declaration, host)
    return BaseView(
        name=host.name,
        site=host.site,
        domain=site.lan.domain,
        time_zone=declaration.pilot.time_zone,
        router=str(site.lan.gateway),
        time_servers=declaration.pilot.time_servers,
        gps=device.gps,
        lan=str(lan),
        ssh_from=_collapse((*site.management.admit, lan, vpn)),
        ssh_port=device.ssh.port,
        dds=_dds(declaration, (lan, vpn)),
        dds_link=dds_link(declaration, host),
        services=tuple(_open_ports(declaration, host.name, device, lan)),
        metered_links=tuple(bearer.name for bearer in site.bearers if bearer.metered),
        watchdog_s=device.watchdog_s,
        neighbours=_neighbours(declaration, host),
        interfaces=(*(() if device.network is None else (device.network.interface,)), *air),
        radios=air,
        access_point_interface=None if access_point is None else access_point.interface,
        way_out=None if access_point is None or not access_point.vpn else _way_out(declaration, access_point),
    )


def _way_out(declaration: Declaration, access_point: model.GatewayAccessPoint) -> WayOut:
    vpn = declaration.pilot.vpn
    return WayOut(str(access_point.network), str(vpn.endpoint), vpn.transport, vpn.port)


def _dds(declaration: Declaration, near: Iterable[IPv4Network]) -> DdsPorts | None:
    dds = declaration.pilot.dds
    if dds is None:
        return None
    far = [site.lan.network for site in declaration.sites.values()] if dds.over is model.DdsPath.LAN else []
    return DdsPorts(dds.domain, dds.all_ports, _collapse((*near, *far)))


def _open_ports(
    declaration: Declaration, host: str, device: model.ServerComputer, lan: IPv4Network
) -> Iterator[OpenPort]:
    """Yield a host's own services, then its shared partner services, which the VPN server opens as well.

    Then the ports that our computers of other sites read for their checklists, and the ports of vehicle streams.
    """
    vpn = declaration.pilot.vpn
    ours = {model.ServiceNetwork.LAN: lan, model.ServiceNetwork.VPN: vpn.infrastructure}
    for service in device.services:
        pools = (declaration.partners[partner].vpn_pool for partner in service.partners)
        sources = _collapse((*(ours[network] for network in service.open_to), *pools))
        if service.port is not None and sources:
            yield OpenPort(service.name, service.transport, service.port, sources)
    everybody = _collapse((vpn.network, *(site.lan.network for site in declaration.sites.values())))
    for vpn_service in vpn.services:
        if vpn_service.host == host:
            yield OpenPort(vpn_service.name, vpn_service.transport, vpn_service.port, everybody)
    if device.vpn_address is not None:
        yield OpenPort(
            "checklists of other sites", model.Transport.UDP, model.REFLECTOR_PORT, (str(vpn.infrastructure),)
        )
    if (qualify := measured_at(host, declaration.pilot)) is not None:
        yield OpenPort("measurements", model.Transport.UDP, qualify.port, ("0.0.0.0/0",))
    if device.ros1_bridge is not None:
        yield OpenPort("ROS 1", model.Transport.TCP, _EPHEMERAL, (f"{device.ros1_bridge.master}/32",))
    yield from _streams(declaration, host, lan)


_EPHEMERAL = "32768-60999"
"""Nodes of ROS 1 listen at ports that the kernel chooses: net.ipv4.ip_local_port_range as Linux has it."""


def _streams(declaration: Declaration, host: str, lan: IPv4Network) -> Iterator[OpenPort]:
    """Yield ports for unsolicited streams: the autopilot's MAVLink stream, read by the checklist."""
    site = declaration.hosts[host].site
    computer, vehicle_keys = declaration.computer_of(site), declaration.sites[site].checklist.vehicles
    if computer is None or computer.name != host:
        return
    for key in declaration.vehicles if vehicle_keys is None else vehicle_keys:
        endpoints = declaration.vehicles[key].endpoints
        wifi, stream = endpoints.wifi, endpoints.rc_rf
        if stream is not None and stream.seen_from is model.SeenFrom.GATEWAY:
            wifi_networks = () if wifi is None or wifi.client is None else (wifi.client.network,)
            yield OpenPort(
                f"remote control of {key}", model.Transport.UDP, stream.port, _collapse((lan, *wifi_networks))
            )


def _collapse(networks: Iterable[IPv4Network]) -> tuple[str, ...]:
    """Merge networks that contain each other: nft refuses overlapping set elements."""
    return tuple(str(network) for network in collapse_addresses(networks))


def _neighbours(declaration: Declaration, host: Host) -> tuple[DeclaredNeighbour, ...]:
    """List computers of the LAN by LAN address, and gateways and servers of other sites by VPN address."""
    lan = declaration.sites[host.site].lan
    neighbours = {
        reservation.name: DeclaredNeighbour(reservation.name, str(reservation.address), lan.domain)
        for reservation in lan.reservations
    }
    for name, other in declaration.hosts.items():
        address = getattr(other.device, "address", None)
        tunnel = getattr(other.device, "vpn_address", None)
        if other.site == host.site and address is not None and address in lan.network:
            neighbours[name] = DeclaredNeighbour(name, str(address), lan.domain)
        elif other.site != host.site and tunnel is not None:
            neighbours[name] = DeclaredNeighbour(name, str(tunnel), None)
    neighbours.pop(host.name, None)
    return tuple(neighbours.values())


PACKAGES = ("chrony", "fake-hwclock", "iputils-ping", "iw", "locales", "nftables", "openssh-server", "tzdata")
"""fake-hwclock keeps the time over a power cut on boards whose clock has no battery; elsewhere it does nothing.

iputils-ping and iw are what the pre-test checklist asks a gateway's radios and cables with.
"""
LOCALE = "en_US.UTF-8"
"""The report's (4.6.2): ROS 2 wants one of UTF-8."""

_CHRONY = "/etc/chrony/chrony.conf"
_FIREWALL = "/etc/nftables.conf"
_GPS = "/etc/default/gpsd"
_JOURNAL = "/etc/systemd/journald.conf.d/atlantis.conf"
_RESOLVED_CONF = "/etc/systemd/resolved.conf.d/60-atlantis.conf"
"""Of a program that not every computer has: elsewhere nobody reads it."""


@dataclass(frozen=True, slots=True)
class GatewayBase:
    """Desired state that the role `gateway_base` installs and configures."""

    packages: tuple[Package, ...]
    configuration: Configuration
    """Empty: nothing but its network is ours."""
    network: NetworkPart | None
    """None: it stays as the image has it."""
    secrets: Mapping[str, str]
    """Word in a file to the vehicle whose key of its access point stands there."""
    own_secret: str | None
    """The word in the place of the key of the gateway's own access point; None: it has none."""
    service_secrets: tuple[str, ...]
    """Words in the places of the secrets of containers, in the order in which these are declared."""
    qualify_secret: str | None = None
    """The word in the place of the key of the far end of measured links; None: it has none."""

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
    declaration: Declaration, host: Host, *, is_rehearsal: bool = False, images: Mapping[str, str] | None = None
) -> GatewayBase:
    """Build the desired base system of a host (pure).

    In a rehearsal the network is not managed: it belongs to the machine that runs the rehearsal. `images` (rehearsal
    only): name of a service to the SHA-256 of the archive that replaces its image.
    """
    assert isinstance(host.device, model.SiteComputer)  # noqa: S101 - callers choose computers that are no server of the VPN
    network = None if is_rehearsal else computer_network(declaration, host)
    if not isinstance(host.device, model.ServerComputer):
        return GatewayBase((), Configuration(), network, secrets={}, own_secret=None, service_secrets=())
    view, air = base_view(declaration, host), radios.gateway_radios(declaration, host, is_rehearsal=is_rehearsal)
    absent = (*(() if view.watchdog_s is not None else (WATCHDOG,)), *air.absent)
    more = (*hosted.packages(host.device), *retrieval_packages(declaration, host))
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
            brought=air.brought,
            checks=(*CHECKS, *air.checks),
            way_in=WayIn(admit=view.ssh_from, port=view.ssh_port, key=True, hint=_hint(view)),
        )
        .merge(reflector(host))
        .merge(dds_link_unit(view.dds_link))
        .merge(far_end(host.name, declaration.pilot))
        .merge(hosted.services(host.device, images))
        .merge(retrieval(declaration, host, is_rehearsal=is_rehearsal)),
        network=network,
        secrets=air.secrets,
        own_secret=None if air.access_point is None else air.access_point.placeholder,
        service_secrets=hosted.secret_words(host.device),
        qualify_secret=None if measured_at(host.name, declaration.pilot) is None else QUALIFY_SECRET,
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
            finding="the declared firewall is not in force",
        ),
    )
    if view.watchdog_s is not None:
        yield _file(view, WATCHDOG, "watchdog.conf.j2")
    if view.gps is not None:
        yield _file(view, _GPS, "gpsd.j2")


_NO_FIREWALL = (
    "where its words are `Operation not supported`, the kernel of this computer was built without nf_tables: "
    "`nft list ruleset` shows it. Take a newer image of the vendor"
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


def _hint(view: BaseView) -> str:
    return (
        f"add the network of your computer to `site.management.admit` in group_vars/{view.site}.yml, "
        f"or work from the LAN of the site ({view.lan})"
    )
