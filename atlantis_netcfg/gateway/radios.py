"""The radios of a gateway computer: each joins access points of vehicles, which an AUV has on the surface.

A unit of systemd for each radio runs wpa_supplicant as long as the radio is there; systemd-networkd gives it its
address, and takes no route, name server or time from a robot. The firewall forwards nothing from or to a radio: robots
of different partners meet in the VPN alone, where its policy says who may reach whom. The keys are no part of this: a
file has a word in the place of each, and the role puts the key there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration import channels
from atlantis_netcfg.declaration.model import SeenFrom, WifiRole
from atlantis_netcfg.gateway.parts import Brought, Check, ConvergeStep, File, Package, Unit
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import WifiEndpoint

FOLDER = "/etc/atlantis/radios"
"""Ours alone: whatever else stands in it goes."""
UNIT = "/etc/systemd/system/atlantis-radio@.service"
NETWORKS = "/etc/systemd/network"
PREFIX = "04-atlantis-radio-"
"""Of our files in there: before all others, for the first that names an interface holds."""
NETWORKD = "systemd-networkd.service"
NO_RADIO = "atlantis-none"
"""A name that no interface has: a program that reads a file for it ends when it looks for the radio."""

ACCEPT_SUPPLICANT = (
    "sh",
    "-c",
    f'! wpa_supplicant -D nl80211 -i {NO_RADIO} -c "$1" 2>&1 | grep -e "^Line" -e "Failed to read or parse"',
    "sh",
    "%s",
)
"""wpa_supplicant cannot only check a file: here it reads it, tells what it does not understand, and finds no radio."""


@dataclass(frozen=True, slots=True)
class AccessPoint:
    """One that a radio may join."""

    vehicle: str
    """Its key in the declaration."""
    wifi: WifiEndpoint

    @property
    def ssid(self) -> str:
        """As wpa_supplicant takes it: in quotes where it is plain, else as hexadecimal digits (wpa_supplicant.conf)."""
        name = self.wifi.ssid or ""
        return f'"{name}"' if name.isascii() and name.isprintable() else name.encode().hex()

    @property
    def pattern(self) -> str:
        """As systemd-networkd takes it: in quotes, with nothing that stands for something else (systemd.network)."""
        name = self.wifi.ssid or ""
        return '"' + "".join(f"\\{letter}" if letter in '*?[]\\"' else letter for letter in name) + '"'

    @property
    def placeholder(self) -> str:
        """The word in the place of its key."""
        return f"@wifi-key-of-{self.vehicle}@"

    @property
    def address(self) -> str | None:
        """Of the radio in its network, with the prefix length; None: by DHCP."""
        client = self.wifi.client
        return None if client is None else f"{client.address}/{client.network.prefixlen}"


@dataclass(frozen=True, slots=True)
class Radio:
    """One radio of a gateway."""

    interface: str
    access_points: tuple[AccessPoint, ...]

    @property
    def file(self) -> str:
        """What wpa_supplicant reads."""
        return f"{FOLDER}/{self.interface}.conf"

    @property
    def unit(self) -> str:
        """What runs it."""
        return f"atlantis-radio@{self.interface}.service"

    @property
    def networks(self) -> dict[str, AccessPoint]:
        """What systemd-networkd reads, a file for each access point."""
        return {f"{NETWORKS}/{PREFIX}{self.interface}-{item.vehicle}.network": item for item in self.access_points}


def radios(declaration: Declaration, host: Host) -> tuple[Radio, ...]:
    """The radios of a gateway that join somebody: by the vehicles that are tested at its site, in their order."""
    tested = declaration.sites[host.site].checklist.vehicles
    found: dict[str, list[AccessPoint]] = {}
    for key in declaration.vehicles if tested is None else tested:
        wifi = declaration.vehicles[key].endpoints.wifi
        joined = wifi is not None and wifi.role is WifiRole.ACCESS_POINT and wifi.seen_from is SeenFrom.GATEWAY
        if wifi is not None and joined and wifi.key is not None:
            found.setdefault(wifi.interface, []).append(AccessPoint(key, wifi))
    return tuple(Radio(interface, tuple(found[interface])) for interface in sorted(found))


@dataclass(frozen=True, slots=True)
class GatewayRadios:
    """What a gateway gets for its radios; without one: what is taken away."""

    radios: tuple[Radio, ...]
    country: str
    """ISO 3166-1: its law holds for the radios."""
    addressed: bool = True
    """False in a rehearsal, whose networks are this computer's: their addresses are left alone."""

    @property
    def packages(self) -> tuple[Package, ...]:
        """What runs a radio."""
        return (Package("wpasupplicant"),) if self.radios else ()

    @property
    def files(self) -> Iterator[File]:
        """Unit, networks and keys."""
        for radio in self.radios:
            text = _render("radio.conf.j2", radio=radio, country=self.country)
            yield File(radio.file, text, mode="0600", validate=ACCEPT_SUPPLICANT)
            for path, item in radio.networks.items() if self.addressed else ():
                yield File(path, _render("radio.network.j2", radio=radio, item=item))
        if self.radios:
            yield File(UNIT, _render("radio.service.j2", folder=FOLDER))

    @property
    def steps(self) -> tuple[ConvergeStep, ...]:
        """What is declared no more is taken away before what is declared is started."""
        kept = [path for radio in self.radios for path in radio.networks]
        names = [radio.unit for radio in self.radios]
        remove = ConvergeStep(
            "take away the radios that are declared no more",
            ("sh", "-c", _TAKE_AWAY, "sh", f" {' '.join(kept)} ", f" {' '.join(names)} "),
            (UNIT,),
        )
        return (remove, *(self._start(radio) for radio in self.radios))

    def _start(self, radio: Radio) -> ConvergeStep:
        run = ("sh", "-c", _START, "sh", radio.unit, radio.interface)
        return ConvergeStep(f"start {radio.interface} where it is plugged in", run, (UNIT, radio.file))

    @property
    def units(self) -> Iterator[Unit]:
        """A radio that is not plugged in is not waited for."""
        if self.radios and self.addressed:
            files = tuple(path for radio in self.radios for path in radio.networks)
            yield Unit(NETWORKD, enabled=True, active=True, after=files, reload=True)
        for radio in self.radios:
            yield Unit(radio.unit, enabled=True, after=(UNIT, radio.file), wait=False)

    @property
    def brought(self) -> tuple[Brought, ...]:
        """A radio is a thing that a person plugs in."""
        return tuple(Brought(f"/sys/class/net/{radio.interface}", self._missing(radio)) for radio in self.radios)

    def _missing(self, radio: Radio) -> str:
        names = ", ".join(item.vehicle for item in radio.access_points)
        if not self.addressed:
            return f"not rehearsed: {radio.interface} joins the access point of {names}, for this machine has no radio"
        return f"there is no radio {radio.interface} here, which joins the access point of {names}: plug it in"

    @property
    def checks(self) -> tuple[Check, ...]:
        """Nobody else drives the radios."""
        if not self.radios:
            return ()
        names = ", ".join(radio.interface for radio in self.radios)
        hint = (
            "on the computer: `nmcli device set NAME managed no`, and the same in a file of /etc/NetworkManager/conf.d"
        )
        words = ("sh", "-c", _ALONE, "sh", *(radio.interface for radio in self.radios))
        return (Check(words, f"NetworkManager drives a radio of {names} as well, and may take it away", hint),)

    @property
    def secrets(self) -> dict[str, str]:
        """Word in a file to the vehicle whose key stands there."""
        return {item.placeholder: item.vehicle for radio in self.radios for item in radio.access_points}


def gateway_radios(declaration: Declaration, host: Host, *, addressed: bool = True) -> GatewayRadios:
    """Pure."""
    country = channels.COUNTRY_CODES[declaration.pilot.country]
    return GatewayRadios(radios(declaration, host), country, addressed)


_TAKE_AWAY = f"""\
gone=
for file in {NETWORKS}/{PREFIX}*.network; do
    case "$1" in *" $file "*) ;; *) [ ! -e "$file" ] || {{ rm -f "$file"; gone=yes; }} ;; esac
done
[ -z "$gone" ] || networkctl reload 2>/dev/null || :
for link in /etc/systemd/system/*.wants/atlantis-radio@*.service; do
    [ -L "$link" ] || continue
    unit="${{link##*/}}"
    case "$2" in *" $unit "*) ;; *) systemctl --quiet disable --now "$unit" 2>/dev/null; rm -f "$link" ;; esac
done
systemctl daemon-reload
"""
_START = """\
systemctl daemon-reload
[ ! -e "/sys/class/net/$2" ] || exec systemctl --no-block start "$1"
"""
"""systemd starts it with the radio; where that is there already, this does."""
_ALONE = """\
command -v nmcli >/dev/null && systemctl --quiet is-active NetworkManager.service || exit 0
for radio; do
    case "$(nmcli --get-values GENERAL.STATE device show "$radio" 2>/dev/null)" in ''|10*) ;; *) exit 1 ;; esac
done
"""
"""10 is `unmanaged` (NMDeviceState)."""


def _render(template: str, **values: object) -> str:
    return environment().get_template(f"gateway/{template}").render(**values)
