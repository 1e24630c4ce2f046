"""The far end of test packets, and this computer's source address towards it.

The far end is this project's reflector at the control centre: it has the key, confirms messages and reports its
counters. Or it is another reflector, in a router or a tester: it answers STAMP (RFC 8762) without a key, and nothing
more.
"""

from __future__ import annotations

import socket
import subprocess
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.reflector import QUALIFY_SERVICE
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model, satellite_allow_list
from atlantis_netcfg.links.qualify.measured_run import Selection
from atlantis_netcfg.links.qualify.reflector.stamp import PORT, reflector_key
from atlantis_netcfg.operations.computers._access import computer_access, key_trouble
from atlantis_netcfg.operations.computers.remote_session import ssh_command

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.request import Request


_OPENING_S = 120.0
"""Timeout in seconds: a gap of a satellite link, and the time that SSH needs over it."""


class NothingToQualify(errors.NoMatchError):
    """The site has no such link or no router to route the packets, or the inventory has no far end."""


@dataclass(frozen=True, slots=True)
class MeasuredFarEnd:
    """The destination of test packets; `name` as in the inventory, or its address."""

    name: str
    address: str
    port: int
    key: bytes | None
    """None: not our reflector; any host with its address could have responded for it."""

    @property
    def is_ours(self) -> bool:
        """Whether it is this project's reflector, which confirms messages and reports its counters."""
        return self.key is not None

    def refuse(self, selection: Selection, links: Iterable[model.Link], inventory: Inventory) -> None:
        """Raise UsageError or NothingToQualify if another's reflector cannot do the selected measurement.

        `links`: the links that see the packets themselves, and not a tunnel around them.
        """
        if self.is_ours:
            return
        if selection is not Selection.TELEMETRY:
            raise errors.UsageError(
                f"`profile={arg(selection)}` needs our own far end, which confirms messages",
                hint="remove `far=`, or type `profile=telemetry`",
            )
        for link in links:
            targets = satellite_allow_list.allowed_targets(inventory.pilot, link)
            if link.kind.traits.allow_list and not satellite_allow_list.admits(
                targets, IPv4Address(self.address), self.port, model.Transport.UDP
            ):
                raise NothingToQualify(
                    f"`{arg(link.name)}` blocks traffic to {arg(self.address)}, UDP port {arg(self.port)}",
                    hint="add it under `allow` of that link, or remove `far=`",
                )


def far_end_of(inventory: Inventory, *, over_vpn: bool, other: str | None = None) -> MeasuredFarEnd:
    """Return the far end of the inventory, or the `other` one typed; raise NothingToQualify or UsageError.

    Only a tunnel over UDP can be routed over another link without breaking.
    """
    if over_vpn and inventory.pilot.vpn.transport is not model.Transport.UDP:
        why = "the VPN uses TCP, and such a tunnel cannot be moved to another link without breaking"
        raise NothingToQualify(why, hint="remove `over=vpn`")
    if other is not None:
        return _parse_far_end(inventory, other, over_vpn=over_vpn)
    qualify, target = inventory.pilot.qualify, satellite_allow_list.far_end(inventory.pilot)
    if qualify is None or target is None:
        hint = "write `qualify: {reflector: …, key: …}` in group_vars/all/pilot.yml (docs/measuring.md)"
        raise NothingToQualify("the inventory has no far end that responds to test packets", hint=hint)
    address = target.address
    if over_vpn:
        device = inventory.hosts[qualify.reflector].device
        inside = device.vpn_address if isinstance(device, model.ServerComputer) else None
        if inside is None:
            raise NothingToQualify(f"`{arg(qualify.reflector)}` has no address in the VPN", hint="remove `over=vpn`")
        address = inside
    return MeasuredFarEnd(qualify.reflector, str(address), qualify.port, key_of(qualify))


def key_of(qualify: model.Qualify) -> bytes:
    """Return the key of the far end in the inventory."""
    return reflector_key(qualify.key.reveal().encode().strip(), qualify.reflector)


class FarEndUnavailable(errors.DeviceError):
    """The program at the far end could not be started; nothing was measured."""


def open_far_end(inventory: Inventory, request: Request) -> None:
    """Start the reflector over SSH; it ends a quarter of an hour after its last packet.

    Raises FarEndUnavailable.
    """
    assert inventory.pilot.qualify is not None  # noqa: S101 - the far end is ours
    host = inventory.hosts[inventory.pilot.qualify.reflector]
    access = computer_access(inventory, host, request)
    line = f"systemctl start {QUALIFY_SERVICE}"
    command = [*ssh_command(access), f"sudo -n {line}" if access["become"] else line]
    hint = msg(
        f"check that you can reach it over SSH; `provision site={arg(host.site)} device={arg(host.name)}` sets it up"
    )
    try:
        process = subprocess.run(  # noqa: S603 - ssh, and arguments that are ours
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_OPENING_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FarEndUnavailable(
            f"{arg(host.name)} did not start the far end of the measurement: {arg(error)}", hint=hint
        ) from None
    if process.returncode:
        if (trouble := key_trouble(host.name, process.stderr)) is not None:
            raise FarEndUnavailable(f"{arg(host.name)} at {arg(access['host'])}: {arg(trouble[0])}", hint=trouble[1])
        last = process.stderr.strip().rpartition("\n")[2] or msg(f"exit {arg(process.returncode)}")
        raise FarEndUnavailable(
            f"{arg(host.name)} did not start the far end of the measurement: {arg(last)}", hint=hint
        )


def _parse_far_end(inventory: Inventory, text: str, *, over_vpn: bool) -> MeasuredFarEnd:
    """Parse a reflector's address as typed by a person; raise UsageError."""
    host, colon, number = text.partition(":")
    try:
        address, port = IPv4Address(host), int(number) if colon else PORT
    except ValueError:
        address, port = IPv4Address(0), 0
    if address.is_unspecified or address.is_multicast or not 0 < port < 1 << 16:
        raise errors.UsageError(
            f"`far={arg(text)}` is not an IPv4 address", hint=f"type it like `far=192.0.2.7:{arg(PORT)}`"
        )
    if over_vpn and address not in inventory.pilot.vpn.network:
        raise errors.UsageError(
            f"`far={arg(text)}` is not an address in the VPN ({arg(inventory.pilot.vpn.network)})",
            hint="remove `over=vpn`",
        )
    return MeasuredFarEnd(text, str(address), port, None)


def source_in_vpn(inventory: Inventory, far: str, port: int) -> str:
    """Return this computer's address in the VPN; raise UsageError if it has no tunnel that is up."""
    address = _address_towards(far, port)
    if address not in inventory.pilot.vpn.network:
        raise errors.UsageError(
            f"this computer has no active tunnel: it would send to {arg(far)} from {arg(address)}",
            hint="measure from a computer connected to the VPN, or remove `over=vpn`",
        )
    return str(address)


def source_of(inventory: Inventory, site: str, far: str, port: int) -> str:
    """Return this computer's address towards the far end; raise UsageError if it is in no network of the site."""
    address = _address_towards(far, port)
    place = inventory.sites[site]
    if address not in place.lan.network and address not in place.management.network:
        raise errors.UsageError(
            f"this computer would send from {arg(address)}, but the router forwards only packets from networks of "
            f"`{arg(site)}`",
            hint=f"connect it to the LAN ({arg(place.lan.network)}) or the management port "
            f"({arg(place.management.network)})",
        )
    return str(address)


def _address_towards(far: str, port: int) -> IPv4Address:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, port))  # no packet is sent by it
            return IPv4Address(probe.getsockname()[0])
        except OSError as error:
            raise errors.UsageError(f"this computer has no route to {arg(far)}: {arg(error.strerror)}") from error
