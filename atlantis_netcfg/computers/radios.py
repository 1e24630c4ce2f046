"""Radios of a gateway computer: they join access points of vehicles, such as a surfaced AUV.

One radio may also be an access point for vehicles that are stations. Each radio has a systemd unit that runs
wpa_supplicant or hostapd while the radio is present. systemd-networkd sets its address, and accepts no route, name
server or time from a robot. The firewall forwards nothing from or to a radio, except to the VPN server if the
inventory allows it: robots of different partners meet only in the VPN, under its policy. Keys are not handled here:
the file has a placeholder for each, and the role inserts the key.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers import parts
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import channels, model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory import Host, Inventory

FOLDER = "/etc/atlantis/radios"
"""Folder managed by this toolkit only: any other content is removed."""
UNIT = "/etc/systemd/system/atlantis-radio@.service"
ACCESS_POINT_UNIT = "/etc/systemd/system/atlantis-access-point@.service"
NETWORKS = "/etc/systemd/network"
PREFIX = "04-atlantis-radio-"
"""Prefix of our files there. It sorts before all others, because the first file that matches an interface applies."""
NO_RADIO = "atlantis-none"
"""Name that no interface has, for checking a configuration file: the program then exits for lack of a radio."""

ACCEPT_HOSTAPD = (
    "sh",
    "-c",
    f'! hostapd -i {NO_RADIO} "$1" 2>&1 | grep -e "^Line" -e "errors found in configuration"',
    "sh",
    "%s",
)
ACCEPT_SUPPLICANT = (
    "sh",
    "-c",
    f'! wpa_supplicant -D nl80211 -i {NO_RADIO} -c "$1" 2>&1 | grep -e "^Line" -e "Failed to read or parse"',
    "sh",
    "%s",
)
"""Check of a wpa_supplicant file. The program has no check mode: it reads the file, reports errors, finds no radio."""


def quote_ssid(ssid: str) -> str:
    """Quote a network name if it is printable ASCII, else encode it as hex (wpa_supplicant.conf)."""
    return f'"{ssid}"' if ssid.isascii() and ssid.isprintable() else ssid.encode().hex()


@dataclass(frozen=True, slots=True)
class AccessPoint:
    """An access point that a radio may join."""

    vehicle: str
    """Key of the vehicle in the inventory."""
    wifi: model.WifiEndpoint

    @property
    def ssid(self) -> str:
        """SSID in the format of wpa_supplicant."""
        return quote_ssid(self.wifi.ssid or "")

    @property
    def pattern(self) -> str:
        """SSID as a systemd-networkd pattern: quoted, with wildcards escaped (systemd.network)."""
        name = self.wifi.ssid or ""
        return '"' + "".join(f"\\{letter}" if letter in '*?[]\\"' else letter for letter in name) + '"'

    @property
    def placeholder(self) -> str:
        """Placeholder of the Wi-Fi key in the file."""
        return f"@wifi-key-of-{self.vehicle}@"

    @property
    def address(self) -> str | None:
        """Address of the radio in the vehicle's network, with prefix length; None: DHCP."""
        client = self.wifi.client
        return None if client is None else f"{client.address}/{client.network.prefixlen}"


@dataclass(frozen=True, slots=True)
class JoiningRadio:
    """A radio of a gateway that joins access points."""

    interface: str
    access_points: tuple[AccessPoint, ...]

    @property
    def file(self) -> str:
        """Path of the wpa_supplicant configuration."""
        return f"{FOLDER}/{self.interface}.conf"

    @property
    def unit(self) -> str:
        """Name of the systemd unit."""
        return f"atlantis-radio@{self.interface}.service"

    @property
    def networks(self) -> dict[str, AccessPoint]:
        """Paths of the systemd-networkd files, one for each access point."""
        return {f"{NETWORKS}/{PREFIX}{self.interface}-{item.vehicle}.network": item for item in self.access_points}


@dataclass(frozen=True, slots=True)
class OpenedNetwork:
    """The radio that is an access point."""

    radio: model.GatewayAccessPoint

    placeholder: str = "@key-of-the-access-point@"

    @property
    def interface(self) -> str:
        """Name of the radio's interface."""
        return self.radio.interface

    @property
    def file(self) -> str:
        """Path of the hostapd configuration."""
        return f"{FOLDER}/{self.interface}.conf"

    @property
    def unit(self) -> str:
        """Name of the systemd unit."""
        return f"atlantis-access-point@{self.interface}.service"

    @property
    def network(self) -> str:
        """Path of the systemd-networkd file."""
        return f"{NETWORKS}/{PREFIX}{self.interface}.network"

    @property
    def ssid(self) -> str:
        """SSID in the format of hostapd's `ssid2` (hostapd.conf)."""
        return quote_ssid(self.radio.ssid)

    @property
    def channel(self) -> int:
        """Channel number (IEEE 802.11, annex E)."""
        return (self.radio.frequency_mhz - (2407 if self.radio.band == "2ghz" else 5000)) // 5

    @property
    def address(self) -> str:
        """Address of the gateway in that network, with prefix length."""
        return f"{self.radio.address}/{self.radio.network.prefixlen}"


def interfaces(inventory: Inventory, host: Host) -> tuple[str, ...]:
    """Return the interfaces of all radios in networks of robots."""
    access_point = opened_radio(host)
    names = [radio.interface for radio in radios(inventory, host)]
    return tuple(names if access_point is None else [*names, access_point.interface])


def opened_radio(host: Host) -> model.GatewayAccessPoint | None:
    """Return the access point radio, or None; only gateways have radios."""
    return host.device.access_point if isinstance(host.device, model.Gateway) else None


def radios(inventory: Inventory, host: Host) -> tuple[JoiningRadio, ...]:
    """Return the radios that join a vehicle's access point; vehicles of the site's checklist, in their order."""
    if not isinstance(host.device, model.Gateway):
        return ()
    vehicle_keys = inventory.sites[host.site].checklist.vehicles
    access_points: dict[str, list[AccessPoint]] = {}
    for key in inventory.vehicles if vehicle_keys is None else vehicle_keys:
        wifi = inventory.vehicles[key].endpoints.wifi
        should_join = (
            wifi is not None and wifi.role is model.WifiRole.ACCESS_POINT and wifi.seen_from is model.SeenFrom.GATEWAY
        )
        if wifi is not None and should_join and wifi.key is not None:
            access_points.setdefault(wifi.interface, []).append(AccessPoint(key, wifi))
    return tuple(JoiningRadio(interface, tuple(access_points[interface])) for interface in sorted(access_points))


@dataclass(frozen=True, slots=True)
class GatewayRadios:
    """Desired state of a gateway's radios; without radios, what is removed."""

    radios: tuple[JoiningRadio, ...]
    country: str
    """Country code (ISO 3166-1) whose regulations apply to the radios."""
    access_point: OpenedNetwork | None = None
    """Radio that is an access point; None: there is none."""
    is_rehearsal: bool = False
    """Whether this is a machine of a rehearsal, which has no radio; a note says so."""

    @property
    def packages(self) -> tuple[parts.Package, ...]:
        """Packages that run the radios."""
        joining = (parts.Package("wpasupplicant"),) if self.radios else ()
        return joining if self.access_point is None else (*joining, parts.Package("hostapd"))

    @property
    def absent(self) -> tuple[str, ...]:
        """Paths of unit files that are no longer needed."""
        needs_by_unit = {UNIT: bool(self.radios), ACCESS_POINT_UNIT: self.access_point is not None}
        return tuple(path for path, there in needs_by_unit.items() if not there)

    @property
    def files(self) -> Iterator[parts.File]:
        """Unit files, network files and key files."""
        for radio in self.radios:
            text = _render("radio.conf.j2", radio=radio, country=self.country)
            yield parts.File(radio.file, text, mode="0600", validate=ACCEPT_SUPPLICANT)
            for path, item in radio.networks.items():
                yield parts.File(path, _render("radio.network.j2", radio=radio, item=item))
        if self.radios:
            yield parts.File(UNIT, _render("radio.service.j2", folder=FOLDER))
        if self.access_point is not None:
            text = _render("access-point.conf.j2", access_point=self.access_point, country=self.country)
            yield parts.File(self.access_point.file, text, mode="0600", validate=ACCEPT_HOSTAPD)
            yield parts.File(
                ACCESS_POINT_UNIT, _render("access-point.service.j2", folder=FOLDER, access_point=self.access_point)
            )
            yield parts.File(
                self.access_point.network, _render("access-point.network.j2", access_point=self.access_point)
            )

    @property
    def _running(self) -> list[tuple[str, str, str, str]]:
        """Interface, unit, unit file and program configuration of each radio."""
        joining = [(radio.interface, radio.unit, UNIT, radio.file) for radio in self.radios]
        if self.access_point is None:
            return joining
        return [
            *joining,
            (self.access_point.interface, self.access_point.unit, ACCESS_POINT_UNIT, self.access_point.file),
        ]

    @property
    def _networks(self) -> tuple[str, ...]:
        network_paths = [path for radio in self.radios for path in radio.networks]
        return tuple(network_paths if self.access_point is None else [*network_paths, self.access_point.network])

    @property
    def steps(self) -> tuple[parts.ConvergeStep, ...]:
        """Steps in order: radios no longer in the inventory are removed before others are started."""
        names = " ".join(unit for _, unit, _, _ in self._running)
        remove = parts.ConvergeStep(
            "remove radios that are no longer in the inventory",
            ("sh", "-c", _TAKE_AWAY, "sh", f" {' '.join(self._networks)} ", f" {names} "),
            (UNIT, ACCESS_POINT_UNIT),
        )
        start = (
            parts.ConvergeStep(
                msg(f"start {arg(name)} if it is plugged in"), ("sh", "-c", _START, "sh", unit, name), (file, read)
            )
            for name, unit, file, read in self._running
        )
        if not self._networks:
            return (remove,)
        reload = parts.ConvergeStep(
            "let systemd-networkd read the networks of radios", ("sh", "-c", _RELOAD), self._networks
        )
        return (remove, reload, *start)

    @property
    def units(self) -> Iterator[parts.Unit]:
        """Units to enable; an unplugged radio is not waited for, and systemd-networkd starts with a plugged one."""
        for _, unit, file, read in self._running:
            yield parts.Unit(unit, enabled=True, after=(file, read), wait=False)
        if self.access_point is not None:
            # Debian's own, which reads another file; it would take every radio of that file.
            yield parts.Unit("hostapd.service", enabled=False, active=False)

    @property
    def plugged_devices(self) -> tuple[parts.UserSuppliedFile, ...]:
        """Radios that a person has to plug in."""
        notes = {radio.interface: self._missing_join_text(radio) for radio in self.radios}
        if self.access_point is not None:
            notes[self.access_point.interface] = self._missing_network_text(self.access_point)
        return tuple(parts.UserSuppliedFile(f"/sys/class/net/{name}", note) for name, note in notes.items())

    def _missing_join_text(self, radio: JoiningRadio) -> str:
        name, vehicles = radio.interface, join(", ", (item.vehicle for item in radio.access_points))
        if self.is_rehearsal:
            return msg(
                f"not rehearsed: {arg(name)} joins the access point of {arg(vehicles)}; this machine has no radio"
            )
        return msg(f"radio {arg(name)}, which joins the access point of {arg(vehicles)}, is missing: plug it in")

    def _missing_network_text(self, access_point: OpenedNetwork) -> str:
        name, ssid = access_point.interface, access_point.radio.ssid
        if self.is_rehearsal:
            return msg(f"not rehearsed: {arg(name)} opens the network {arg(ssid)}; this machine has no radio")
        return msg(f"radio {arg(name)}, which opens the network {arg(ssid)}, is missing: plug it in")

    @property
    def checks(self) -> tuple[parts.Check, ...]:
        """Checks that no other program manages the radios."""
        names = [name for name, _, _, _ in self._running]
        if not names:
            return ()
        hint = (
            "on the computer: `nmcli device set NAME managed no`, and the same in a file of /etc/NetworkManager/conf.d"
        )
        finding = msg(f"NetworkManager also manages a radio of {arg(join(', ', names))}, and may take it over")
        return (parts.Check(("sh", "-c", _ALONE, "sh", *names), finding, hint),)

    @property
    def secrets(self) -> dict[str, str]:
        """Placeholder in a file, mapped to the vehicle whose key replaces it."""
        return {item.placeholder: item.vehicle for radio in self.radios for item in radio.access_points}


def gateway_radios(inventory: Inventory, host: Host, *, is_rehearsal: bool = False) -> GatewayRadios:
    """Build the desired state of a host's radios (pure); on other computers all our files are removed."""
    country = channels.COUNTRY_CODES[inventory.pilot.country]
    access_point = opened_radio(host)
    return GatewayRadios(
        radios(inventory, host), country, None if access_point is None else OpenedNetwork(access_point), is_rehearsal
    )


_TAKE_AWAY = f"""\
gone=
for file in {NETWORKS}/{PREFIX}*.network; do
    case "$1" in *" $file "*) ;; *) [ ! -e "$file" ] || {{ rm -f "$file"; gone=yes; }} ;; esac
done
[ -z "$gone" ] || networkctl reload 2>/dev/null || :
for link in /etc/systemd/system/*.wants/atlantis-*@*.service; do
    [ -L "$link" ] || continue
    unit="${{link##*/}}"
    case "$unit" in atlantis-radio@*|atlantis-access-point@*) ;; *) continue ;; esac
    case "$2" in *" $unit "*) ;; *) systemctl --quiet disable --now "$unit" 2>/dev/null; rm -f "$link" ;; esac
done
systemctl daemon-reload
"""
_RELOAD = "! systemctl --quiet is-active systemd-networkd.service || exec networkctl reload"
_START = """\
systemctl daemon-reload
[ ! -e "/sys/class/net/$2" ] || exec systemctl --no-block start "$1"
"""
"""Start a unit if its radio is already present; otherwise systemd starts it with the radio."""
_ALONE = """\
command -v nmcli >/dev/null && systemctl --quiet is-active NetworkManager.service || exit 0
for radio; do
    case "$(nmcli --get-values GENERAL.STATE device show "$radio" 2>/dev/null)" in ''|10*) ;; *) exit 1 ;; esac
done
"""
"""Check that NetworkManager does not manage the radios; state 10 is `unmanaged` (NMDeviceState)."""


def _render(template: str, **values: object) -> str:
    return environment().get_template(f"gateway/{template}").render(**values)
