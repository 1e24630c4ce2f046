"""A link and its far end in a rehearsal: the reflector as a separate program behind a relay.

The relay has the behaviour of the link in the inventory, or as measured by a run (`link_shapes`).

The emulated router does not carry the packets. It holds the rows, is informed afterwards of what the relay carried, and
routes and counts it by its own rules (`emulator/routeros/network/traffic.py`).
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.udp_link import UdpRelay
from atlantis_netcfg.links.qualify.budget import IPV4_HEADERS, VPN_HEADERS
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.common.link_shapes import link_shapes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.operations.common.rehearsal import Rehearsal
    from atlantis_netcfg.operations.qualify.routing import MeasuredFlow

_LINK = "the link behaves exactly as set under `rate`"
_TUNNEL_PORT = 1194
"""VPN port of the emulated computer."""
_VPN = "the VPN: its bytes are added to each packet, but no tunnel is created"
_FAR_END = "the far end: a real measurement first starts it over SSH"
_ROUTER = "the router does not carry the test packets; its counters are set from a relay on this computer"


def not_rehearsed(emulators: Rehearsal, *, over_vpn: bool = False) -> tuple[str, ...]:
    """Return the limits of a rehearsal as text."""
    vpn = (_VPN,) if over_vpn else ()
    return (_LINK if emulators.replay is None else emulators.replay.not_rehearsed, _ROUTER, _FAR_END, *vpn)


@dataclass(slots=True)
class EmulatedLink:
    """A running relay, and the emulated router that is informed of its traffic."""

    relay: UdpRelay
    emulators: Rehearsal

    @contextmanager
    def transport(self) -> Iterator[UdpTransport]:
        """Open a transport for a sender in front of the relay."""
        with UdpTransport(self.relay.address, source="127.0.0.1") as sender:
            yield sender

    def tell(self, router: str, flow: MeasuredFlow) -> list[str]:
        """Report the carried traffic to the router; return its messages."""
        up, down = self.relay.up, self.relay.down
        arrived_packets = down.sent_count - down.loss_count - down.drop_count - down.in_gaps + down.copies
        answer = self.emulators.emulators.do(
            router,
            "carry",
            source=flow.source,
            source_port=flow.source_port or _TUNNEL_PORT,
            target=flow.far,
            target_port=flow.far_port,
            up=[up.sent_count, up.sent_bytes],
            down=[arrived_packets, down.delivered_bytes],
        )
        if answer["passed"]:
            return []
        port = answer["port"] or "any port"
        return [msg(f"the emulated router would not have passed any test packet through {arg(port)}")]


@contextmanager
def emulated_link(
    link: Link, key: bytes | None, emulators: Rehearsal, *, over_vpn: bool = False
) -> Iterator[EmulatedLink]:
    """Start far end and relay until the context ends; the VPN is emulated by its header bytes only."""
    headers = IPV4_HEADERS + (VPN_HEADERS if over_vpn else 0)
    with (
        temporary.folder("qualify") as folder,
        _reflector(folder, key) as port,
        UdpRelay(("127.0.0.1", port), *link_shapes(link, emulators.replay), headers=headers) as relay,
    ):
        yield EmulatedLink(relay, emulators)


@contextmanager
def _reflector(folder: Path, key: bytes | None) -> Iterator[int]:
    module, who = ["-P", "-m", "atlantis_netcfg.links.qualify.reflector"], ["--unauthenticated"]
    if key is not None:
        write_private(folder / "key", key)
        who = ["--key-file", str(folder / "key")]
    where = ["--address", "127.0.0.1", "--port", "0", *who]
    with subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, *module, *where], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdout is not None  # noqa: S101 - it is a pipe
            ready = process.stdout.readline().split()
            if not ready or not ready[-1].isdecimal():
                raise NetcfgError("the far end of the rehearsal did not start")
            yield int(ready[-1])
        finally:
            process.terminate()
