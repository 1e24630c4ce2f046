"""Rules for DDS: each participant has an address on the chosen path and is listed as a peer once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest
from atlantis_netcfg.inventory.rules.networks import example_in, why_unusable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address


_PILOT = _draft.Part("pilot")


def _dds_settings(draft: _draft.Draft) -> model.Dds | None:
    return draft.pilot.dds if draft.pilot is not None else None


def participants_have_addresses(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a VPN address for gateways and control centres whose DDS traffic uses the VPN."""
    dds = _dds_settings(draft)
    if dds is None or dds.over is not model.DdsPath.VPN:
        return
    for host, device in draft.devices.items():
        if isinstance(device, model.ServerComputer) and device.vpn_address is None:
            where = draft.where(_PILOT, "dds")
            message = msg(f"`{arg(host)}` uses DDS over the VPN ({arg(where)}), but has no VPN address")
            yield draft.finding_at(_draft.Part("device", host), (), message, "set its `vpn_address:`")


def peers_in_the_vpn(draft: _draft.Draft) -> Iterator[Finding]:
    """Require tunnel addresses for peers if DDS uses the VPN."""
    dds = _dds_settings(draft)
    if draft.pilot is None or dds is None or dds.over is not model.DdsPath.VPN:
        return
    network = draft.pilot.vpn.network
    for index, peer in enumerate(dds.peers):
        if why := why_unusable(peer.address, network):
            message = msg(
                f"the peer `{arg(peer.name)}` is reached over the VPN, but {arg(peer.address)} {arg(why)}, the network "
                "of the VPN"
            )
            yield draft.finding_at(_PILOT, ("dds", "peers", index, "address"), message, example_in(network))


def peers_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report duplicate peers: each is announced to all the time, and inventory hosts are peers automatically."""
    dds = _dds_settings(draft)
    if dds is None:
        return
    owner_by_address: dict[IPv4Address, str] = {}
    for host, device in draft.devices.items():
        if isinstance(device, model.ServerComputer):
            address = device.vpn_address if dds.over is model.DdsPath.VPN else device.address
            if address is not None:
                owner_by_address[address] = msg(f"`{arg(host)}`, which is always a peer")
    for index, peer in enumerate(dds.peers):
        if peer.address in owner_by_address:
            message = msg(f"{arg(peer.address)} is already {arg(owner_by_address[peer.address])}")
            yield draft.finding_at(_PILOT, ("dds", "peers", index, "address"), message, "remove this peer")
        owner_by_address.setdefault(peer.address, msg(f"the peer `{arg(peer.name)}`"))


def peers_at_known_sites(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the site named by a peer exists."""
    dds = _dds_settings(draft)
    for index, peer in enumerate(dds.peers if dds is not None else ()):
        site_names = draft.names("site")
        if peer.site is not None and peer.site not in site_names:
            hint = suggest(peer.site, site_names, none="add it to hosts.yml")
            yield draft.finding_at(
                _PILOT, ("dds", "peers", index, "site"), msg(f"site `{arg(peer.site)}` does not exist"), hint
            )


def processes_are_found(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `participants` ≥ `processes`: others do not start (Cyclone DDS) or are not discovered (Fast DDS)."""
    dds = _dds_settings(draft)
    if dds is not None and dds.processes > dds.participants:
        message = msg(
            f"{arg(dds.processes)} ROS processes run on a computer, but only {arg(dds.participants)} of them can be "
            "found"
        )
        hint = msg(f"write `participants: {arg(dds.processes)}`, or a lower number here")
        yield draft.finding_at(_PILOT, ("dds", "processes"), message, hint)


RULES: tuple[_draft.Rule, ...] = (
    participants_have_addresses,
    peers_in_the_vpn,
    peers_once,
    peers_at_known_sites,
    processes_are_found,
)
