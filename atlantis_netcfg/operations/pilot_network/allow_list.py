"""The allow-list test of a satellite while the sites of a rehearsal are joined: every target is tried with packets."""

from __future__ import annotations

from contextlib import ExitStack
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.allow_list_test.prove import ProofPace
from atlantis_netcfg.operations.allow_list_test.site import try_out
from atlantis_netcfg.operations.allow_list_test.vpn import VpnQuestion
from atlantis_netcfg.operations.vpn.router import identity_for
from atlantis_netcfg.vpn.pki.keys import FirstPacket

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.allow_list_test.prove import Proof, Proving
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.operations.pilot_network.rehearsal import PilotRehearsal

_PACE: Final = ProofPace(window_s=10.0, every_s=2.0)
"""In real seconds; longer than the one TCP connection that a refused target has. Silence proves nothing so soon."""


def prove_allow_list(
    pilot: PilotRehearsal, inventory: Inventory, router: Host, request: Request, proving: Proving
) -> Proof:
    """Run the test of `try_out` with `--try-all`, from a computer that is plugged into the LAN of the router's site.

    Raises as `try_out`, and MachineError.
    """
    vpn, source = inventory.pilot.vpn, inventory.sites[router.site].lan.dhcp.last
    identity = identity_for(inventory, router, pilot.request)
    far_end = str(vpn.endpoint), vpn.port
    with ExitStack() as stack:
        sockets = hosts.NamespaceSockets(stack.enter_context(pilot.network.guest(router, source)))
        stack.callback(sockets.close)
        transport = stack.enter_context(sockets.call(lambda source: UdpTransport(far_end, source=source), str(source)))
        proving.try_all, proving.pace = True, _PACE
        proving.vpn = VpnQuestion(str(source), transport, FirstPacket(identity.wrap_key))
        return try_out(inventory, router, request, proving)
