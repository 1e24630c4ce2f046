"""A link and its far end for a rehearsal: our reflector as a program of its own, behind a relay of the declared rate.

The emulated router does not carry the packets. It holds the rows, is told afterwards what the relay carried, and leads
and counts it by its own rules (`emulator/routeros/network/traffic.py`).
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.paths import write_private
from atlantis_netcfg.emulator.udp_link import LinkShape, UdpRelay
from atlantis_netcfg.qualify.transport import UdpTransport

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from atlantis_netcfg.declaration.model import Bearer
    from atlantis_netcfg.operations.qualify.way import MeasuredFlow
    from atlantis_netcfg.operations.rehearsal import Rehearsal

NOT_REHEARSED = (
    "the link: delay and rate are those that are declared, and nothing is lost on it",
    "the router: it does not carry the test packets, and is told afterwards what a relay of this computer carried",
)


def link_shapes(bearer: Bearer) -> tuple[LinkShape, LinkShape]:
    """What the link does up and down, by its declaration."""
    delay_s = bearer.rate.rtt_ms / 2000
    up, down = (rate * 1000 for rate in (bearer.rate.up_kbps, bearer.rate.down_kbps))
    return LinkShape(rate_bps=up, delay_s=delay_s), LinkShape(rate_bps=down, delay_s=delay_s)


@dataclass(slots=True)
class EmulatedLink:
    """A relay that runs, and the emulated router that is told what it carried."""

    relay: UdpRelay
    twins: Rehearsal

    @contextmanager
    def transport(self) -> Iterator[UdpTransport]:
        """Of a sender in front of the relay."""
        with UdpTransport(self.relay.address, source="127.0.0.1") as opened:
            yield opened

    def tell(self, router: str, flow: MeasuredFlow) -> list[str]:
        """Tell the router what was carried; what has to be said of it."""
        up, down = self.relay.up, self.relay.down
        arrived = down.sent - down.lost - down.dropped - down.in_gaps + down.copies
        answer = self.twins.twins.do(
            router,
            "carry",
            source=flow.source,
            source_port=flow.source_port,
            target=flow.far,
            target_port=flow.far_port,
            up=[up.sent, up.sent_bytes],
            down=[arrived, down.delivered_bytes],
        )
        if answer["passed"]:
            return []
        port = answer["port"] or "any port"
        return [f"the emulated router would have let none of the test packets pass by {port}"]


@contextmanager
def emulated_link(bearer: Bearer, key: bytes, twins: Rehearsal) -> Iterator[EmulatedLink]:
    """Start the far end and the relay before it; both end with the context."""
    with (
        temporary.folder("qualify") as folder,
        _reflector(folder, key) as port,
        UdpRelay(("127.0.0.1", port), *link_shapes(bearer)) as relay,
    ):
        yield EmulatedLink(relay, twins)


@contextmanager
def _reflector(folder: Path, key: bytes) -> Iterator[int]:
    write_private(folder / "key", key)
    module = ["-P", "-m", "atlantis_netcfg.qualify.reflector"]
    where = ["--address", "127.0.0.1", "--port", "0", "--key-file", str(folder / "key")]
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
