"""One end of a directional Wi-Fi bridge."""

from __future__ import annotations

from ipaddress import IPv4Interface, IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import Cpe, PtpProtocol, RadioMenus
from atlantis_netcfg.operations.kinds._managed import Hardware, Managed, Place, Text
from atlantis_netcfg.render import cpe, cpe_prerequisites, cpe_view, radio_name

if TYPE_CHECKING:
    from collections.abc import Collection

    from atlantis_netcfg.declaration import Host
    from atlantis_netcfg.declaration.model import Access, Ptp
    from atlantis_netcfg.render import Prerequisite

__all__ = ["ManagedCpe", "families"]

_MENUS = {"wireless": "/interface/wireless", "wifi": "/interface/wifi"}
_PACKAGES = {"wireless": "wireless", "wifi": "wifi-qcom"}
_AX = "802.11ax"
_INSTALL = (
    "put the package `wireless` on it (802.11ax and some newer 802.11ac devices: `wifi-qcom`, `wifi-qcom-ac`), of the "
    "same version as RouterOS, reboot it, and run this command again"
)
_OR_WIRELESS = ", or put the package `wireless` on both if their radios can do with it"


def families(ptp: Ptp) -> tuple[str, ...]:
    """Return the families of radio menus that can do what is declared, the one with nv2 first."""
    allowed = ("wireless", "wifi") if ptp.menus is RadioMenus.AUTO else (ptp.menus.value,)
    plain = ptp.protocol is PtpProtocol.IEEE_80211
    legacy = ptp.standard != _AX and not (plain and ptp.wpa == "wpa3")
    return tuple(family for family in allowed if (legacy if family == "wireless" else plain))


class ManagedCpe(Managed):
    """Managed at its one cable, from the router's side; which menus its radio has is asked when it is read."""

    __slots__ = ()

    @staticmethod
    def takes(host: Host) -> bool:
        """Tell whether a host is of this kind."""
        return isinstance(host.device, Cpe)

    @property
    def cpe(self) -> Cpe:
        """What is declared of it."""
        assert isinstance(self.host.device, Cpe)  # noqa: S101 - `takes` has said so
        return self.host.device

    @property
    def access(self) -> Access:
        """As declared."""
        return self.cpe.access

    def texts(self) -> tuple[Text, ...]:
        """Return one text for each family of menus that can do what is declared."""
        return tuple(Text(cpe(self.declaration, self.host, one), _MENUS[one]) for one in families(self.cpe.ptp))

    def prerequisites(self) -> tuple[Prerequisite, ...]:
        """Its port and its certificate."""
        return cpe_prerequisites(self.declaration, self.host)

    @property
    def place(self) -> Place:
        """The cable; the technician stands behind this site's router, which masquerades, or beside it with a laptop.

        The laptop's address is the highest of the link's network that no declared device has.
        """
        view = cpe_view(self.declaration, self.host, families(self.cpe.ptp)[0])
        return Place(view.management.address, view.port, self._laptop(IPv4Network(view.network)))

    def _laptop(self, network: IPv4Network) -> str:
        boxes = (host.device for host in self.declaration.hosts.values())
        taken = {str(box.access.address) for box in boxes if isinstance(box, Cpe)}
        for site in self.declaration.sites.values():
            taken |= {str(bearer.address) for bearer in site.bearers} | {
                str(each.address) for each in site.served_links
            }
        free = [str(address) for address in network.hosts() if str(address) not in taken]
        return free[-1] if free else str(IPv4Interface(network[-2]).ip)

    @property
    def hardware(self) -> Hardware:
        """A box with one port and one radio; its driver is the first that can do what is declared."""
        family = families(self.cpe.ptp)[0]
        return Hardware(
            ports=(self.cpe.port,),
            radios=(radio_name(family),),
            packages=("routeros", _PACKAGES[family]),
            board="SXTsq 5 ac",
        )

    def unfit(self, radios: Collection[str]) -> tuple[str, str]:
        """Say why: no driver at all, or one that cannot do what is declared."""
        name, ptp = self.host.name, self.cpe.ptp
        if not radios:
            why = "has no radio that is driven: since RouterOS 7.13 `wireless` is a package of its own"
            todo = _INSTALL
        elif ptp.menus not in (RadioMenus.AUTO, there := "wifi" if _MENUS["wifi"] in radios else "wireless"):
            why = f"is declared with the `{ptp.menus}` menus, and its radio is driven by the `{there}` ones"
            todo = f"write `menus: {there}` or `menus: auto` under `ptp` in host_vars/{name}.yml"
        elif there == "wifi":
            why = f"is declared with protocol {ptp.protocol}, and its radio has the `wifi` menus, which only do 802.11"
            todo = f'write `protocol: "802.11"` under `ptp` of {name} and of {ptp.peer}{_OR_WIRELESS}'
        else:
            newer, older = (_AX, "an older standard") if ptp.standard == _AX else ("wpa3", "`wpa: wpa2`")
            why = f"is declared with {newer}, and its radio has the `wireless` menus, which do not know it"
            todo = f"choose {older} under `ptp` of {name} and of {ptp.peer}, or take devices with the `wifi` menus"
        return f"{name} {why}", todo
