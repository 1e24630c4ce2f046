"""Probe of the VPN server over an idle link: this computer sends, and the router routes and counts.

As in `provision measure link`, a routing rule applies to this computer's address alone, so that the tunnels of the site
keep their route. The request is the first packet of a session, which only the pilot's server can answer. The link's
filter counters show that it went over the link.
"""

from __future__ import annotations

import asyncio
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.emulator.udp_link import UdpRelay
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.common.link_shapes import link_shapes
from atlantis_netcfg.operations.qualify.emulation import EmulatedLink
from atlantis_netcfg.operations.qualify.far_end import source_of
from atlantis_netcfg.operations.qualify.routing import MeasuredFlow
from atlantis_netcfg.operations.vpn.router import identity_for
from atlantis_netcfg.vpn.identity import Wrap
from atlantis_netcfg.vpn.pki.keys import FirstPacket
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity, vpn_server

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal
    from atlantis_netcfg.operations.common.request import Request

_QUESTIONS, _EVERY_S = 6, 15.0
"""Number of requests and their interval: they outlast a satellite's gaps and fit into the silence window."""


@dataclass(frozen=True, slots=True)
class VpnQuestion:
    """A request to the VPN server from a socket of this computer."""

    source: str
    """Source address that the router routes over the link."""
    transport: UdpTransport
    packet: FirstPacket
    on_answer: Callable[[], object] | None = None

    async def answered_after_s(self) -> float | None:
        """Send requests until the server responds; return the delay in seconds, None if it was silent."""
        begin_ns = self.transport.now_ns()
        for number in range(_QUESTIONS):
            self.transport.send(self.packet.datagram())
            if await asyncio.to_thread(self._is_answered, begin_ns + int((number + 1) * _EVERY_S * 1e9)):
                if self.on_answer is not None:
                    self.on_answer()
                return (self.transport.now_ns() - begin_ns) / 1e9
        return None

    def _is_answered(self, until_ns: int) -> bool:
        arrivals = iter(lambda: self.transport.receive(until_ns), None)
        return any(self.packet.is_answer(arrival.datagram) for arrival in arrivals)


@contextmanager
def vpn_trial(
    inventory: Inventory, router: Host, site_link: Link, request: Request, emulators: Rehearsal | None
) -> Iterator[VpnQuestion | NetcfgError]:
    """Open the probe of a link, or yield the error that prevents it; in a rehearsal a real OpenVPN responds locally."""
    far = str(inventory.pilot.vpn.endpoint), inventory.pilot.vpn.port
    with ExitStack() as stack:
        trial: VpnQuestion | NetcfgError
        try:
            if emulators is None:
                identity, source = identity_for(inventory, router, request), source_of(inventory, router.site, *far)
                asking, tell = stack.enter_context(UdpTransport(far, source=source)), None
            else:
                identity = rehearsed_identity(inventory, router, Wrap.TLS_CRYPT)
                source = str(inventory.sites[router.site].management.technician)
                server = "127.0.0.1", stack.enter_context(vpn_server(identity))
                link = EmulatedLink(
                    stack.enter_context(UdpRelay(server, *link_shapes(site_link, emulators.replay))), emulators
                )
                asking = stack.enter_context(link.transport())
                tell = partial(link.tell, router.name, MeasuredFlow(source, asking.source[1], *far))
            trial = VpnQuestion(source, asking, FirstPacket(identity.wrap_key), tell)
        except NetcfgError as error:
            trial = error
        yield trial
