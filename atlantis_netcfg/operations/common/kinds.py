"""The device kinds that the RouterOS engine handles: one entry per kind, used by all other code.

A new kind is a subclass of `ManagedDevice` in its own module, with its name in `_KINDS`; its group is listed in
`playbooks/site.yml` (a test compares the two).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from ipaddress import IPv4Interface, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.emulator import routeros
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros import render

if TYPE_CHECKING:
    from collections.abc import Collection

    from atlantis_netcfg.inventory import Host, Inventory


@dataclass(frozen=True, slots=True)
class KindText:
    """A desired text of a device, with the radio menu that it requires."""

    text: str
    """Text with secrets in clear: never print it."""
    radio: str = ""
    """Radio menu that the device must have for this text; empty: there is only this text."""


@dataclass(frozen=True, slots=True)
class HostPlace:
    """The port and address by which an adopted device is managed."""

    address: str
    """Address with prefix length."""
    port: str
    """Factory name of the port."""
    technician: str
    """Source of the management packets: the laptop, or the router in front of it."""


@dataclass(frozen=True, slots=True)
class Hardware:
    """The hardware of an emulated device of this kind, by factory names."""

    ports: tuple[str, ...]
    poe_ports: tuple[str, ...] = ()
    radios: tuple[str, ...] = ()
    modem: routeros.ModemSpec | None = None
    packages: tuple[str, ...] = ("routeros",)
    board: str = "RB5009UPr+S+"


@dataclass(frozen=True, slots=True)
class ManagedDevice(ABC):
    """A device of the inventory that the RouterOS engine configures; each kind is a subclass."""

    inventory: Inventory
    host: Host

    @staticmethod
    @abstractmethod
    def takes(host: Host) -> bool:
        """Return whether a host is of this kind."""

    @property
    @abstractmethod
    def access(self) -> model.Access:
        """Address, port, user and password of the device, and the link to it."""

    @abstractmethod
    def texts(self) -> tuple[KindText, ...]:
        """Render the desired texts; more than one if the device's hardware decides which applies. Raise RenderError."""

    @abstractmethod
    def prerequisites(self) -> tuple[render.Prerequisite, ...]:
        """Return what must exist on the device before a text can be written."""

    @property
    @abstractmethod
    def place(self) -> HostPlace:
        """The port and address by which the device is managed."""

    @property
    @abstractmethod
    def hardware(self) -> Hardware:
        """The hardware of the emulated device."""

    def unfit(self, radios: Collection[str]) -> tuple[str, str]:
        """Return why no text fits a device with radios in these menus, and what to do about it."""
        there = conjunction(sorted(radios)) or "no radio"
        return msg(
            f"{arg(self.host.name)} has {arg(there)}, which is not in the inventory"
        ), "correct its host_vars file"

    @property
    def certificates(self) -> tuple[str, ...]:
        """Names of the certificates that the device's text refers to."""
        return tuple(prerequisite.name for prerequisite in self.prerequisites() if prerequisite.menu == "/certificate")


_MENUS = {"wireless": "/interface/wireless", "wifi": "/interface/wifi"}
_PACKAGES = {"wireless": "wireless", "wifi": "wifi-qcom"}
_AX = "802.11ax"
_INSTALL = (
    "install the package `wireless` (802.11ax and some newer 802.11ac devices: `wifi-qcom`, `wifi-qcom-ac`) "
    "of the same version as RouterOS, reboot, and run this command again"
)
_OR_WIRELESS = ", or install the package `wireless` on both, if their radios support it"


def families(ptp: model.Ptp) -> tuple[str, ...]:
    """Return the families of radio menus that support these settings, the one with nv2 first."""
    candidates = ("wireless", "wifi") if ptp.menus is model.RadioMenus.AUTO else (ptp.menus.value,)
    plain = ptp.protocol is model.PtpProtocol.IEEE_80211
    legacy = ptp.standard != _AX and not (plain and ptp.wpa == "wpa3")
    return tuple(family for family in candidates if (legacy if family == "wireless" else plain))


class ManagedCpe(ManagedDevice):
    """A CPE, managed over its only cable from the router's side; reading the device shows its radio menus."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Return whether a host is a CPE."""
        return isinstance(host.device, model.Cpe)

    @property
    def cpe(self) -> model.Cpe:
        """The CPE in the inventory."""
        assert isinstance(self.host.device, model.Cpe)  # noqa: S101 - `takes` has said so
        return self.host.device

    @property
    def access(self) -> model.Access:
        """The access settings of the inventory."""
        return self.cpe.access

    def texts(self) -> tuple[KindText, ...]:
        """Return one text for each family of menus that supports the settings."""
        return tuple(
            KindText(render.cpe(self.inventory, self.host, family), _MENUS[family]) for family in families(self.cpe.ptp)
        )

    def prerequisites(self) -> tuple[render.Prerequisite, ...]:
        """Return the required port and certificate."""
        return render.cpe_prerequisites(self.inventory, self.host)

    @property
    def place(self) -> HostPlace:
        """The cable; the technician is behind this site's router, which masquerades, or connected with a laptop.

        The laptop's address is the highest one of the link's network that no device of the inventory has.
        """
        view = render.cpe_view(self.inventory, self.host, families(self.cpe.ptp)[0])
        return HostPlace(view.management.address, view.port, self._free_laptop_address(IPv4Network(view.network)))

    def _free_laptop_address(self, network: IPv4Network) -> str:
        boxes = (host.device for host in self.inventory.hosts.values())
        used_addresses = {str(box.access.address) for box in boxes if isinstance(box, model.Cpe)}
        for site in self.inventory.sites.values():
            used_addresses |= {str(link.address) for link in site.bearers} | {
                str(each.address) for each in site.served_links
            }
        free = [str(address) for address in network.hosts() if str(address) not in used_addresses]
        return free[-1] if free else str(IPv4Interface(network[-2]).ip)

    @property
    def hardware(self) -> Hardware:
        """A device with one port and one radio, whose driver is the first that supports the settings."""
        family = families(self.cpe.ptp)[0]
        return Hardware(
            ports=(self.cpe.port,),
            radios=(render.radio_name(family),),
            packages=("routeros", _PACKAGES[family]),
            board="SXTsq 5 ac",
        )

    def unfit(self, radios: Collection[str]) -> tuple[str, str]:
        """Return why no text fits: no driver, or one that does not support the settings."""
        name, ptp = self.host.name, self.cpe.ptp
        if not radios:
            why = "has no radio with a driver: since RouterOS 7.13 `wireless` is a separate package"
            todo = _INSTALL
        elif ptp.menus not in (model.RadioMenus.AUTO, there := "wifi" if _MENUS["wifi"] in radios else "wireless"):
            why = msg(f"has the `{arg(ptp.menus)}` menus in the inventory, but its radio has the `{arg(there)}` menus")
            todo = msg(f"write `menus: {arg(there)}` or `menus: auto` under `ptp` in host_vars/{arg(name)}.yml")
        elif there == "wifi":
            why = msg(
                f"has protocol {arg(ptp.protocol)} in the inventory, but its radio has the `wifi` menus, which support "
                "only 802.11"
            )
            todo = msg(
                f'write `protocol: "802.11"` under `ptp` of {arg(name)} and of {arg(ptp.peer)}{arg(_OR_WIRELESS)}'
            )
        else:
            newer, older = (_AX, "an older standard") if ptp.standard == _AX else ("wpa3", "`wpa: wpa2`")
            why = msg(
                f"has {arg(newer)} in the inventory, but its radio has the `wireless` menus, which do not support it"
            )
            todo = msg(
                f"choose {arg(older)} under `ptp` of {arg(name)} and of {arg(ptp.peer)}, or use devices with the "
                "`wifi` menus"
            )
        return f"{name} {why}", todo


class ManagedLte(ManagedDevice):
    """A RouterOS 4G unit, managed over its only cable from the router's side."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Return whether a host is a 4G unit with RouterOS: other units have separate drivers."""
        return isinstance(host.device, model.LteRouter) and host.device.driver is model.LteDriver.ROUTEROS

    @property
    def access(self) -> model.Access:
        """The access settings of the inventory; the unit is always reached over the site's 4G link."""
        device = self.host.device
        assert isinstance(device, model.LteRouter)  # noqa: S101 - `takes` has said so
        assert device.access is not None  # noqa: S101 - a rule of the inventory
        credentials = {"user": device.access.user, "password": device.access.password}
        port = {} if device.access.port is None else {"port": device.access.port}
        return model.Access.model_validate({"address": device.address, **credentials, **port})

    def texts(self) -> tuple[KindText, ...]:
        """Return the only text."""
        return (KindText(render.lte(self.inventory, self.host)),)

    def prerequisites(self) -> tuple[render.Prerequisite, ...]:
        """Return the required modem, port and certificate."""
        return render.lte_prerequisites(self.inventory, self.host)

    @property
    def place(self) -> HostPlace:
        """The cable; the technician is behind the site's router, which masquerades."""
        view = render.lte_view(self.inventory, self.host)
        return HostPlace(view.management.address, view.port, str(render.lte_link(self.inventory, self.host).address))

    @property
    def hardware(self) -> Hardware:
        """A device with one port and one modem; SIM PIN and access point are those of the inventory.

        The SIM is in its home network: tests of roaming configure that themselves.
        """
        view = render.lte_view(self.inventory, self.host)
        cell = routeros.CellSpec(apns=() if view.apn is None else (view.apn,), bands=view.bands or (3,))
        card = routeros.SimSpec(pin="" if view.pin is None else view.pin.reveal())
        bands = tuple(sorted({*routeros.ModemSpec().bands, *view.bands}))
        modem = routeros.ModemSpec(name=view.modem, sim=card, cell=cell, bands=bands)
        return Hardware(ports=(view.port,), modem=modem, board="LHG LTE6 kit")


class ManagedPorts(ManagedDevice):
    """A device with ports in the inventory and possibly a radio: router or switch."""

    __slots__ = ()

    @property
    def _port_device(self) -> model.Router | model.Switch:
        assert isinstance(self.host.device, model.Router | model.Switch)  # noqa: S101 - `takes` has said so
        return self.host.device

    @property
    def access(self) -> model.Access:
        """The access settings of the inventory."""
        return self._port_device.access

    @property
    def hardware(self) -> Hardware:
        """The ports of the inventory, and the radio of an access point."""
        ports: tuple[model.Port | model.SwitchPort, ...] = self._port_device.ports
        radio = self._port_device.access_point
        hardware = Hardware(
            ports=tuple(port.name for port in ports),
            poe_ports=tuple(port.name for port in ports if port.poe is not None),
        )
        if radio is None:
            return hardware
        return replace(
            hardware, radios=(render.radio_name(radio.menus),), packages=("routeros", _PACKAGES[radio.menus])
        )

    @property
    def _radio(self) -> str:
        """The radio menu that the access point requires; empty without an access point."""
        return "" if self._port_device.access_point is None else _MENUS[self._port_device.access_point.menus]

    def unfit(self, radios: Collection[str]) -> tuple[str, str]:
        """Return why no text fits: no radio driver, or the wrong one."""
        name, radio = self.host.name, self._port_device.access_point
        if not radios:
            return msg(f"{arg(name)} has no radio with a driver, but an access point in the inventory"), _INSTALL
        there = "wifi" if _MENUS["wifi"] in radios else "wireless"
        menus = "" if radio is None else radio.menus
        why = msg(
            f"{arg(name)} has an access point with the `{arg(menus)}` menus in the inventory, but its radio has the "
            f"`{arg(there)}` menus"
        )
        return why, msg(f"write `menus: {arg(there)}` under `access_point` in host_vars/{arg(name)}.yml")


class ManagedRouter(ManagedPorts):
    """A router, managed from the technician's port."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Return whether a host is a router."""
        return isinstance(host.device, model.Router)

    def texts(self) -> tuple[KindText, ...]:
        """Return the only text; with an access point it requires a radio in the menus of the inventory."""
        return (KindText(render.router(self.inventory, self.host), self._radio),)

    def prerequisites(self) -> tuple[render.Prerequisite, ...]:
        """Return the required ports and certificates."""
        return render.prerequisites(self.inventory, self.host)

    @property
    def place(self) -> HostPlace:
        """The management port."""
        network = self.inventory.sites[self.host.site].management
        return HostPlace(
            address=str(IPv4Interface(f"{self.access.address}/{network.network.prefixlen}")),
            port=next(port.name for port in self._port_device.ports if port.use == model.PortUse.MANAGEMENT),
            technician=str(network.technician),
        )


class ManagedSwitch(ManagedPorts):
    """A switch, managed over its cable to the router."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Return whether a host is a switch."""
        return isinstance(host.device, model.Switch)

    def texts(self) -> tuple[KindText, ...]:
        """Return the only text; with an access point it requires a radio in the menus of the inventory."""
        return (KindText(render.switch(self.inventory, self.host), self._radio),)

    def prerequisites(self) -> tuple[render.Prerequisite, ...]:
        """Return the required ports, certificate and radio."""
        return render.switch_prerequisites(self.host)

    @property
    def place(self) -> HostPlace:
        """The cable to the router, which masquerades: a laptop connected instead uses the router's address."""
        lan = self.inventory.sites[self.host.site].lan
        assert isinstance(self.host.device, model.Switch)  # noqa: S101 - `takes` has said so
        return HostPlace(
            address=str(IPv4Interface(f"{self.access.address}/{lan.network.prefixlen}")),
            port=self.host.device.uplink,
            technician=str(lan.gateway),
        )


_KINDS: tuple[type[ManagedDevice], ...] = (ManagedRouter, ManagedSwitch, ManagedCpe, ManagedLte)


def is_supported(host: Host) -> bool:
    """Return whether the RouterOS engine handles a host."""
    return any(kind.takes(host) for kind in _KINDS)


def get_managed_device(inventory: Inventory, host: Host) -> ManagedDevice:
    """Return the managed device of a host; raise NoMatchError if the engine does not handle it."""
    for kind in _KINDS:
        if kind.takes(host):
            return kind(inventory, host)
    raise NoMatchError(f"{arg(host.name)} is a {arg(host.device.kind.replace('_', ' '))}, which is not supported yet")


def is_other_lte_unit(host: Host) -> bool:
    """Return whether a host is a 4G unit with a separate driver, not handled by the RouterOS engine."""
    return isinstance(host.device, model.LteRouter) and host.device.driver is not model.LteDriver.ROUTEROS
